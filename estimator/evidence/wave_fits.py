"""Turns, bends and process of an uneven wave that are likeliest together (Gauss-Newton).

The spread of the turns follows in turn: see `estimator.evidence.turns_by_chance`. The noise model
and the dead time are held.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from compiled import kernel
from estimator.algebra import (
    dot,
    filter_rows,
    local_equations,
    project_out,
    solve_spd,
)
from estimator.arrays import Array
from estimator.evidence.piecewise_loads import without_load
from estimator.evidence.turns_by_chance import (
    inverse_of,
    precision_of,
    price_of_turns,
    spread_of,
)
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.linear_fit import left_of_pv
from estimator.hypotheses.piecewise_load import NO_PROCESS
from estimator.hypotheses.uneven_wave import UnevenWave, course_of, slopes_of, through_process
from estimator.processes.poles import Poles, Shape

__all__ = ["Wave", "fit_wave"]

_TRIES = 6
"""Lengths of a step that are tried."""
_DONE = 0.05
"""Nats of a step below which it was the last."""
_NUDGE = 0.01
"""Step of log time constants for the derivative of a response."""
_FARTHEST = 0.5
"""Step of log time constants at most."""
_POLE = 0.5
"""Precision of a step of log time constants: where a process does nothing they stay."""
_APART = 0.3
"""Samples from one turn to the next at least."""
_DAMPED = (1e-3, 1e-4, 6.0, 0.2)
"""Damping of a step (Levenberg-Marquardt): the first, the least, and its factors after a step that
failed and one that did not."""


@dataclass(frozen=True, slots=True)
class Wave:
    """Turns and bends of a wave, its process, and how well it does.

    Attributes:
        times, heights: of its ``m`` turns, each ``(m,)``; see `UnevenWave`.
        bends: of rises and of falls, ``(2, k)``.
        poles: the process that OP goes through, and the wave where it enters at the valve.
        squares: sum of squares of what it leaves, whitened.
        price: what turns and bends cost, in nats.
        lag: time constant in samples of a lag of its own that it goes through; None where it has
            none, and goes through the process or enters at PV.
    """

    times: Array
    heights: Array
    bends: Array
    poles: Poles
    squares: float
    price: float
    lag: float | None = None

    def through(self, at_valve: bool) -> Poles | None:
        """The process that it goes through; None where it enters at PV."""
        if self.lag is not None:
            return Poles(Shape.LAGS, self.lag)
        return self.poles if at_valve else None

    def nuisance(self, at_valve: bool) -> UnevenWave:
        """The load alone, which enters at the valve or at PV."""
        rises, falls = (tuple(float(x) for x in row) for row in self.bends)
        return UnevenWave(
            tuple(float(x) for x in self.times),
            tuple(float(x) for x in self.heights),
            (rises, falls),
            self.through(at_valve),
            self.price,
        )


class _Way:
    """What a wave and a process leave of PV, the noise model and the dead time held."""

    def __init__(self, case: Case, of: Hypothesis, taps: Array, at_valve: bool) -> None:
        self.case, self.of, self.at_valve = case, of, at_valve
        self.taps = np.ascontiguousarray(taps)
        self.others = without_load(of)

    def left(self, wave: Wave) -> tuple[Array, Array]:
        """What is left ``(n,)``, whitened, and the basis ``(k, n)`` of process and columns."""
        rows, of = self.case.rows, self.of
        columns = self.case.columns(self.others, of.stem, wave.poles, of.dead_time)
        response = wave.poles.response(of.stem)
        basis, left = left_of_pv(rows, response, of.dead_time, columns, self.taps)
        made = through_process(self.course(wave)[None], self._process(wave))
        return left - project_out(filter_rows(made, self.taps, rows.weight)[0], basis), basis

    def turned(self, wave: Wave) -> Array:
        """Change of the wave's part with each number of it, whitened, ``(p, n)``."""
        slopes = slopes_of(wave.times, wave.heights, wave.bends, self.case.rows.size)
        made = through_process(slopes, self._process(wave))
        return filter_rows(made, self.taps, self.case.rows.weight)

    def swayed(self, wave: Wave, left: Array, free: list[int]) -> Array:
        """Change of the model with the log of each free time constant, ``(k, n)``."""
        steps = _NUDGE * np.eye(len(free) + int(wave.lag is not None))
        found = np.empty((steps.shape[0], left.size))
        for row, step in enumerate(steps):
            found[row] = (left - self.left(_swayed(wave, step, free))[0]) / _NUDGE
        return found

    def _process(self, wave: Wave) -> tuple[float, float, float, float]:
        """Coefficients of what the wave goes through."""
        through = wave.through(self.at_valve)
        return NO_PROCESS if through is None else through.coefficients

    def course(self, wave: Wave) -> Array:
        """The load ``(n,)``."""
        found: Array = course_of(self.case.rows.size, wave.times, wave.heights, wave.bends)
        return found


def _swayed(wave: Wave, step: Array, free: list[int]) -> Wave:
    """The wave with the logs of its free time constants moved, that of its own lag the last."""
    steps = np.zeros((1, 3))
    steps[0, free] = step[: len(free)]
    poles = wave.poles.of_row(wave.poles.moved(steps)[0])
    lag = None if wave.lag is None else wave.lag * float(np.exp(step[-1]))
    return replace(wave, poles=poles, lag=lag)


def _free(poles: Poles) -> list[int]:
    """Which of the three numbers of a process move."""
    values = (poles.slow, poles.fast, poles.third)
    return [i for i in range(3) if values[i] > 0.0 and not (poles.integrating and i == 0)]


def fit_wave(
    case: Case,
    of: Hypothesis,
    taps: Array,
    at_valve: bool,
    wave: Wave,
    *,
    rounds: int,
    spreads: int,
) -> Wave:
    """Turns, bends and poles that are likeliest together; the spread of the turns in turn.

    Args:
        case: the window.
        of: the hypothesis beside which it is fitted; any load of a course of its own is left out.
        taps: noise model.
        at_valve: whether it enters at the valve, or at PV.
        wave: where to begin.
        rounds, spreads: steps with one spread of the turns at most, and spreads in turn.
    """
    way = _Way(case, of, taps, at_valve)
    m, count = wave.times.size, case.rows.count
    free = _free(wave.poles)
    swaying = len(free) + int(wave.lag is not None)
    open_ = np.zeros((2 * m, 2 * m))
    left, basis = way.left(wave)
    squares = dot(left, left)
    damping = _DAMPED[0]
    for _ in range(spreads):
        spread = spread_of(wave.times, wave.heights, open_)
        precision, mean = _with_poles(
            precision_of(spread, wave.times[0], m, wave.bends.size), swaying
        )
        for _ in range(rounds):
            variance = squares / count + case.rows.floor
            slopes = np.vstack([way.turned(wave), way.swayed(wave, left, free)])
            at = _numbers(wave, swaying)
            told, pull = local_equations(slopes, basis, left)
            told, pull = told / variance + precision, pull / variance - precision @ at + mean
            cost = 0.5 * squares / variance + _kept_by(precision, mean, at)
            gained = 0.0
            for _ in range(_TRIES):
                damped = told + damping * np.diag(np.diag(told))
                step = solve_spd(damped, pull)
                moved = _moved(wave, step, free)
                if moved is not None:
                    new_left, new_basis = way.left(moved)
                    new_squares = dot(new_left, new_left)
                    new = 0.5 * new_squares / variance + _kept_by(precision, mean, at + step)
                    gained = cost - new
                    if gained > 0.0:
                        break
                damping = max(damping, _DAMPED[1]) * _DAMPED[2]
            if moved is None or not gained > 0.0:
                break
            wave, left, basis, squares = moved, new_left, new_basis, new_squares
            damping *= _DAMPED[3]
            if gained < _DONE:
                break
        told, _ = local_equations(way.turned(wave), basis, left)
        told /= squares / count + case.rows.floor
        p = told.shape[0]
        open_ = inverse_of(told + precision[:p, :p])[: 2 * m, : 2 * m]
    spread = spread_of(wave.times, wave.heights, open_)
    precision, mean = precision_of(spread, wave.times[0], m, wave.bends.size)
    price = price_of_turns(_numbers(wave, 0), told, precision, mean, count)
    if wave.lag is not None:
        price += 0.5 * math.log(count)
    return replace(wave, squares=squares, price=price)


def _numbers(wave: Wave, swaying: int) -> Array:
    """Times, heights, bends and steps of so many time constants, ``(p,)``."""
    return np.concatenate([wave.times, wave.heights, wave.bends.T.ravel(), np.zeros(swaying)])


def _moved(wave: Wave, step: Array, free: list[int]) -> Wave | None:
    """The wave after a step of all its numbers; None where turns would pass each other."""
    m, p = wave.times.size, 2 * wave.times.size + wave.bends.size
    times = wave.times + step[:m]
    if not (np.diff(times) > _APART).all():
        return None
    step[p:] = np.clip(step[p:], -_FARTHEST, _FARTHEST)
    swayed = _swayed(wave, step[p:], free)
    if _free(swayed.poles) != free:
        return None
    bends = wave.bends + step[2 * m : p].reshape(-1, 2).T
    return replace(swayed, times=times, heights=wave.heights + step[m : 2 * m], bends=bends)


def _with_poles(prior: tuple[Array, Array], k: int) -> tuple[Array, Array]:
    """Precision and mean of a wave with those of the steps of ``k`` time constants."""
    precision, mean = prior
    p = mean.size
    whole = np.zeros((p + k, p + k))
    whole[:p, :p] = precision
    whole[range(p, p + k), range(p, p + k)] = _POLE
    return whole, np.concatenate([mean, np.zeros(k)])


@kernel
def _kept_by(precision: Array, mean: Array, at: Array) -> float:
    """Minus the logarithm of a normal density, but for a constant."""
    total = 0.0
    for i in range(at.size):
        total -= mean[i] * at[i]
        for j in range(at.size):
            total += 0.5 * at[i] * precision[i, j] * at[j]
    return total
