"""Controller settings from an identified process, each by a published rule.

* ``largest_integral_gain``: PI of the largest integral gain whose sensitivity stays below a chosen
  Ms: for loads at the process's entry the integrated error is Ti / Kc. It works for any process.
  Astrom, Panagopoulos and Hagglund (1998), "Design of PI controllers based on non-convex
  optimization", Automatica 34, 585-601.
* ``simc``: PI and PID of Skogestad (2003), "Simple analytic rules for model reduction and PID
  controller tuning", Journal of Process Control 13, 291-309; the closed-loop time constant is the
  effective dead time, Ms is then 1.6 to 1.7.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array
from estimator.controller.controller import Controller
from estimator.diagnosis.linear_loop import LinearLoop
from loop_model import ProcessModel

__all__ = ["HOLD", "largest_integral_gain", "simc", "simc_lag"]

Complex = NDArray[np.complex128]

_GRID = np.geomspace(5e-4, 0.5, 400)
_TIMES = 40
_GAINS = np.geomspace(1e-4, 1e4, 120)
_HALVINGS = 28
HOLD = 0.5
"""Dead time of sample and hold, samples."""
_FILTERED = 0.1
"""Time constant of the filter over the derivative time: the usual tenth."""


def largest_integral_gain(
    process: ProcessModel, running: Controller, robustness: float
) -> Controller | None:
    """PI settings of the largest integral gain at a sensitivity; None where there are none."""
    unit = replace(running, structure="PI", derivative_time_s=0.0, filter_time_s=0.0)
    unit = replace(unit, filter_on="all")
    probe = LinearLoop.of(process, replace(unit, gain=1.0, integral_rate=0.0))
    response = probe.process_response(_GRID)
    if not np.isfinite(response).all() or not np.median(np.abs(response)) > 0.0:
        return None
    side = math.copysign(1.0, math.fsum(process.b))
    q = np.exp(-2j * math.pi * _GRID)
    times = np.geomspace(0.7, 0.25 / _GRID[0], _TIMES)
    shapes = side * response * (1.0 + 1.0 / (times[:, None] * (1.0 - q)))
    best = int(np.argmax(_first_crossings(shapes, robustness) / times))
    gain = _largest_gain(shapes[best], robustness)
    if gain is None:
        return None
    return _controller(running, side * gain, times[best] * process.period, 0.0)


def _first_crossings(shapes: Complex, robustness: float) -> Array:
    """`_largest_gain` of each row from roots, to rounding; 0 where there is none.

    At each frequency ``|1 + g L|^2`` is a parabola in the gain, below ``1 / Ms^2`` between its
    roots. What lies between two gains of the table is not seen.
    """
    sizes = np.abs(shapes)
    scale = np.median(sizes, axis=1, keepdims=True)
    left, squares = -shapes.real / scale, np.square(sizes / scale)
    space = 1.0 - robustness**-2
    under = left**2 - space * squares
    falls = (left > 0.0) & (under > 0.0)
    sums = left[falls] + np.sqrt(under[falls])
    low = np.full(shapes.shape, math.inf)
    low[falls] = space / sums
    after = np.searchsorted(_GAINS, low)
    seen = np.zeros(shapes.shape, dtype=bool)
    seen[falls] = np.append(_GAINS, math.inf)[after[falls]] < sums / squares[falls]
    first = np.where(seen, low, math.inf).min(axis=1)
    first[~np.isfinite(first) | (seen & (after == 0)).any(axis=1)] = 0.0
    return np.asarray(first / scale[:, 0])


def _largest_gain(shape: Complex, robustness: float) -> float | None:
    """Largest gain up to which the sensitivity never exceeded ``robustness``."""
    scale = 1.0 / float(np.median(np.abs(shape)))
    gains = scale * _GAINS
    peaks = np.max(1.0 / np.abs(1.0 + gains[:, None] * shape[None]), axis=1)
    # beyond the first crossing the loop is unstable and the peaks mean nothing
    over = np.flatnonzero(peaks > robustness)
    if over.size == 0 or over[0] == 0:
        return None
    low, high = float(gains[over[0] - 1]), float(gains[over[0]])
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        if np.max(1.0 / np.abs(1.0 + middle * shape)) > robustness:
            high = middle
        else:
            low = middle
    return low


def simc_lag(slope: float, lag: float, dead: float) -> tuple[float, float]:
    """SIMC's gain and integral time for a lag with a dead time.

    Args:
        slope: first rise after a step of OP, PV per OP and second: gain over lag.
        lag: its time constant in seconds, infinite for an integrator.
        dead: dead time in seconds.
    """
    return 1.0 / slope / (2.0 * dead), min(lag, 8.0 * dead)


def simc(process: ProcessModel, running: Controller) -> tuple[Controller, ...]:
    """SIMC's PI settings, and its PID settings where a second lag exceeds the dead time.

    None of them for a process whose poles swing, or that has no lag: the rule has no form for it.
    """
    h = process.period
    poles = np.roots([1.0, *process.a])
    if poles.size == 0 or np.any(np.abs(poles.imag) > 1e-6) or np.any(poles.real <= 0.0):
        return ()
    integrates = process.is_integrating
    real = np.sort(poles.real)[::-1]
    lags = [-h / math.log(p) for p in (real[1:] if integrates else real) if 0.0 < p < 1.0]
    if not integrates and len(lags) < real.size:
        return ()
    # two coefficients are a dead time between two samples
    between = process.b[1] / math.fsum(process.b) if len(process.b) == 2 else 0.0
    dead = (running.samples_late(process.dead_time) - HOLD + between) * h
    if integrates:
        rest = float(np.polyval(np.polydiv(np.array([1.0, *process.a]), [1.0, -1.0])[0], 1.0))
        return _simc_integrating(running, math.fsum(process.b) / rest / h, lags, dead)
    first, *others = lags
    found = []
    second, third = [*others, 0.0, 0.0][:2]
    gain = process.gain
    late = dead + 0.5 * second + third
    lag = first + 0.5 * second
    found.append(_controller(running, *simc_lag(gain / lag, lag, late), 0.0))
    if second > dead:
        late = dead + 0.5 * third
        found.append(
            _in_parallel(running, *simc_lag(gain / first, first, late), second + 0.5 * third)
        )
    return tuple(found)


def _simc_integrating(
    running: Controller, slope: float, lags: list[float], dead: float
) -> tuple[Controller, ...]:
    """For ``slope e^-Ls / s``, slope in PV per OP and second, with lags."""
    first, second = [*lags, 0.0, 0.0][:2]
    late = dead + first + second
    found = [_controller(running, *simc_lag(slope, math.inf, late), 0.0)]
    if first > dead:
        late = dead + 0.5 * second
        found.append(_in_parallel(running, *simc_lag(slope, math.inf, late), first + 0.5 * second))
    return tuple(found)


def _in_parallel(running: Controller, gain: float, time: float, derivative: float) -> Controller:
    """The ideal form of settings of a PI and a PD in series."""
    factor = 1.0 + derivative / time
    return _controller(running, gain * factor, time * factor, derivative / factor)


def _controller(running: Controller, gain: float, time: float, derivative: float) -> Controller:
    return replace(
        running,
        structure="PID" if derivative else "PI",
        gain=gain,
        integral_time_s=time,
        derivative_time_s=derivative,
        integral_rate=gain / time,
        filter_time_s=_FILTERED * derivative,
        filter_on="all",
    )
