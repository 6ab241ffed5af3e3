"""Local linear trend of estimates with known spread: Kalman filter and RTS smoother.

The slope wanders as a random walk in continuous time, so windows may come at any distance; how much
it wanders is found by maximum likelihood from the series itself. Where the estimates scatter more
than their intervals allow, the intervals are widened by one common factor.

Source: Harvey (1989), "Forecasting, Structural Time Series Models and the Kalman Filter";
Rauch, Tung and Striebel (1965), AIAA Journal 3, 1445-1450.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Trend", "smooth_trend"]

Array = NDArray[np.float64]

# Wander tried, as the variance it adds to the level over the whole series over the variance of one
# estimate: from a straight line to a level that follows every window.
_WANDER = np.concatenate([[0.0], np.geomspace(1e-2, 1e7, 19)])
_DIFFUSE = 1e7


@dataclass(frozen=True, slots=True)
class Trend:
    """Smoothed level and slope at the given times, and what a forecast needs.

    Attributes:
        level, level_std: shape ``(n,)``.
        slope, slope_std: per unit of time, shape ``(n,)``.
        covariance: of level and slope at the last time, shape ``(2, 2)``.
        wander: variance that the slope gains per unit of time.
        widening: factor on the given variances, 1 or more.
    """

    level: Array
    level_std: Array
    slope: Array
    slope_std: Array
    covariance: Array
    wander: float
    widening: float

    def forecast(self, ahead: Array) -> tuple[Array, Array]:
        """Level and its standard deviation ``ahead`` of the last time, shape ``(m,)``."""
        p = self.covariance
        variance = p[0, 0] + 2.0 * ahead * p[0, 1] + ahead**2 * p[1, 1]
        return (
            self.level[-1] + ahead * self.slope[-1],
            np.sqrt(np.maximum(variance + self.wander * ahead**3 / 3.0, 0.0)),
        )


def _noise(step: float, wander: float) -> Array:
    return wander * np.array([[step**3 / 3.0, step**2 / 2.0], [step**2 / 2.0, step]])


@dataclass(slots=True)
class _Pass:
    """One run of the filter: states before and after each observation, and its likelihood."""

    before: list[Array]
    before_cov: list[Array]
    after: list[Array]
    after_cov: list[Array]
    squares: float
    log_det: float
    counted: int

    @property
    def widening(self) -> float:
        return self.squares / self.counted if self.counted else 1.0

    @property
    def log_likelihood(self) -> float:
        """Concentrated over the common factor on all variances, which is at least 1."""
        factor = max(1.0, self.widening)
        return -0.5 * (self.counted * math.log(factor) + self.log_det + self.squares / factor)


def _filter(time: Array, value: Array, variance: Array, wander: float) -> _Pass:
    scale = float(np.median(variance[np.isfinite(variance)]))
    first = float(value[np.isfinite(value)][0])
    state = np.array([first, 0.0])
    reach = max(1.0, float(np.ptp(time)))
    cov = scale * _DIFFUSE * np.diag([1.0, 1.0 / reach**2])
    run = _Pass([], [], [], [], 0.0, 0.0, 0)
    seen = 0
    for k in range(time.size):
        if k:
            step = float(time[k] - time[k - 1])
            move = np.array([[1.0, step], [0.0, 1.0]])
            state, cov = move @ state, move @ cov @ move.T + _noise(step, wander)
        run.before.append(state)
        run.before_cov.append(cov)
        if np.isfinite(value[k]):
            spread = float(cov[0, 0] + variance[k])
            gap = float(value[k] - state[0])
            # The first two observations only pin down what was unknown before them.
            if seen >= 2:
                run.squares += gap * gap / spread
                run.log_det += math.log(spread)
                run.counted += 1
            seen += 1
            gain = cov[:, 0] / spread
            state = state + gain * gap
            keep = np.eye(2) - np.outer(gain, [1.0, 0.0])
            cov = keep @ cov @ keep.T + np.outer(gain, gain) * variance[k]
        run.after.append(state)
        run.after_cov.append(cov)
    return run


def smooth_trend(time: Array, value: Array, std: Array) -> Trend:
    """Smooth ``value`` (shape ``(n,)``, NaN where there is none) with known ``std`` at ``time``.

    Needs at least one value; with fewer than three, the spread of the slope says how little is
    known of it.
    """
    variance = np.where(np.isfinite(value), std**2, np.nan)
    unit = float(np.nanmedian(variance)) / max(1.0, float(np.ptp(time))) ** 3
    runs = [(float(r) * unit, _filter(time, value, variance, float(r) * unit)) for r in _WANDER]
    wander, run = max(runs, key=lambda item: item[1].log_likelihood)
    state, cov = run.after[-1], run.after_cov[-1]
    states, covs = [state], [cov]
    for k in range(time.size - 2, -1, -1):
        step = float(time[k + 1] - time[k])
        move = np.array([[1.0, step], [0.0, 1.0]])
        back = np.linalg.solve(run.before_cov[k + 1], move @ run.after_cov[k]).T
        state = run.after[k] + back @ (state - run.before[k + 1])
        cov = run.after_cov[k] + back @ (cov - run.before_cov[k + 1]) @ back.T
        states.append(state)
        covs.append(cov)
    widening = max(1.0, run.widening)
    level, slope = np.array(states[::-1]).T
    spread = widening * np.array(covs[::-1])
    return Trend(
        level=level,
        level_std=np.sqrt(np.maximum(spread[:, 0, 0], 0.0)),
        slope=slope,
        slope_std=np.sqrt(np.maximum(spread[:, 1, 1], 0.0)),
        covariance=spread[-1],
        wander=wander * widening,
        widening=widening,
    )
