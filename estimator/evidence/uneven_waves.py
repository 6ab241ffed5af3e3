"""A load that swings unevenly, looked for beside a valve.

Where it turns is first told by a load of steps and lines (`piecewise_loads`), with several
processes; then turns, shape and process move together (Gauss-Newton), then noise and dead time, in
turn. See `estimator.hypotheses.uneven_wave` for the wave.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from compiled import kernel
from estimator.algebra import dot, filter_rows, project_out, solve_spd
from estimator.arrays import Array, Index
from estimator.evidence.piecewise_loads import outline_load, without_load
from estimator.evidence.turns_by_chance import (
    inverse_of,
    precision_of,
    price_of_turns,
    spread_of,
)
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.linear_fit import left_of_pv
from estimator.hypotheses.noise import DRIFT_AND_NOISE
from estimator.hypotheses.piecewise_load import NO_PROCESS
from estimator.hypotheses.uneven_wave import UnevenWave, course_of, slopes_of, through_process
from estimator.processes.poles import Poles, Shape
from estimator.search.processes import polish

__all__ = ["find_uneven_wave", "refit_uneven_wave"]

_OUTLINED = 4.0
"""Nats that a corner of the outline must gain: about what a turn costs."""
_SWINGS = (1.0, 2.0)
"""Standard deviations of the outline that it must swing by to turn: small corners are noise."""
_FEWEST_TURNS, _MOST_TURNS = 10, 80
"""Turns of a wave in the window: fewer than five cycles tell no distribution, and one of more than
these is too fast to be told from noise."""
_REPEATED = 0.2
"""Deviation, over a cycle, of an outline's lengths at most: twice that of a wave's."""
_FOLLOWED = 2
"""Of all starts, those that are fitted in turn."""
_AT_VALVE, _AT_PV = ((20.0, 6), (3.0, 6)), ((8.0, 6),)
"""Lags and dead times, in samples, with which a wave at the valve is looked for, and one on PV."""
_HOPE, _BENT = 150.0, 60.0
"""Nats that an outlined wave may still gain, and one that has no bends. It saves time: of a dozen
simulated waves some gain up to 190. The second is a guess."""
_ALIKE = 1.0
"""Nats within which two starts lead to the same wave."""
_BENDS = (0, 2)
"""Sines of a rise's bend: none is a line, two make it a sine's or a lag's."""
_TURNS, _LONG = 3, 8
"""Wave and noise are fitted in turn so often at most, and the likeliest once more."""
_GAINED = 0.5
"""Nats of a turn below which it was the last."""
_ROUNDS, _TRIES = 6, 6
"""Steps of a fit, and lengths of one that are tried."""
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
class _Wave:
    """Turns and bends of a wave, its process, and how well it does."""

    times: Array
    heights: Array
    bends: Array
    poles: Poles
    squares: float
    price: float

    def nuisance(self, at_valve: bool) -> UnevenWave:
        rises, falls = (tuple(float(x) for x in row) for row in self.bends)
        return UnevenWave(
            tuple(float(x) for x in self.times),
            tuple(float(x) for x in self.heights),
            (rises, falls),
            self.poles if at_valve else None,
            self.price,
        )


def find_uneven_wave(case: Case, sticky: Hypothesis, least: float) -> Hypothesis | None:
    """The healthy valve with the likeliest load that swings unevenly.

    It is looked for with the process of the sticky valve and with some lags and dead times. None
    where none is found, or has no hope to become as likely as ``least``.
    """
    healthy = replace(sticky, valve=None, stem=case.rows.u, taps=DRIFT_AND_NOISE, nuisances=())
    starts = [(healthy, True)]
    for lags, at_valve in ((_AT_VALVE, True), (_AT_PV, False)):
        for slow, dead_time in lags:
            if dead_time <= case.max_dead_time:
                poles = Poles(Shape.LAGS, slow)
                starts.append((replace(healthy, poles=poles, dead_time=dead_time), at_valve))
    return _likeliest(case, starts, least)


def refit_uneven_wave(
    case: Case, of: Hypothesis, known: Hypothesis, least: float
) -> Hypothesis | None:
    """The hypothesis with the likeliest such load in place of any other of a course of its own.

    It keeps its valve and what else is beside it, and begins from its process. The turns of the
    wave that is ``known`` beside another are tried too. None as above.
    """
    return _likeliest(case, [(of, True), (of, False)], least, tuple(_known_turns(known)))


def _likeliest(
    case: Case,
    starts: list[tuple[Hypothesis, bool]],
    least: float,
    known: tuple[tuple[Array, Array], ...] = (),
) -> Hypothesis | None:
    """The likeliest wave from processes beside which it enters at the valve, or at PV."""
    tried: list[tuple[float, Hypothesis, bool, _Wave]] = []
    for start, at_valve in starts:
        outline = outline_load(case, start, at_valve, _OUTLINED)
        for times, heights in (*_turns_of(outline), *known):
            wave = _Wave(times, heights, np.zeros((2, 0)), start.poles, 0.0, 0.0)
            wave = _fit(case, start, start.taps, at_valve, wave, rounds=3, spreads=1)
            others, sticky = without_load(start), start.valve is not None
            price = case.price(wave.poles, others, start.taps, sticky) + wave.price
            tried.append((case.log_likelihood(wave.squares) - price, start, at_valve, wave))
    tried.sort(key=lambda one: -round(one[0], 6))
    best: tuple[Hypothesis, _Wave, bool] | None = None
    followed: list[tuple[float, bool]] = []
    for worth, start, at_valve, wave in tried:
        if worth < least - _HOPE or len(followed) == _FOLLOWED:
            break
        if any(way == at_valve and abs(worth - one) < _ALIKE for one, way in followed):
            continue
        followed.append((worth, at_valve))
        found, last = _in_turn(case, start, start.taps, at_valve, wave, _TURNS)
        if best is None or found.likelihood > best[0].likelihood:
            best = found, last, at_valve
    if best is None or best[0].likelihood < least - _BENT:
        return None
    start, wave, at_valve = best
    ends = [start]
    for count in _BENDS:
        bent = replace(wave, bends=np.zeros((2, count)))
        ends.append(_in_turn(case, start, start.taps, at_valve, bent, _LONG)[0])
    return max(ends, key=lambda one: one.likelihood)


def _in_turn(
    case: Case, start: Hypothesis, taps: Array, at_valve: bool, wave: _Wave, most: int
) -> tuple[Hypothesis, _Wave]:
    """Wave with process, then noise and dead time, in turn."""
    at, best = start, None
    for _ in range(most):
        found = _fit(case, at, taps, at_valve, wave, rounds=_ROUNDS, spreads=2)
        nuisances = (*without_load(at), found.nuisance(at_valve))
        one = polish(
            case, at.valve, (found.poles, at.dead_time), nuisances, taps, passes=2, wide=False
        )
        gained = math.inf if best is None else one.likelihood - best[0].likelihood
        if gained > 0.0:
            best = one, found
        if gained < _GAINED:
            break
        at, wave, taps = one, found, one.taps
    assert best is not None
    return best


def _turns_of(outline: Array) -> Iterator[tuple[Array, Array]]:
    """Times and heights of the turns of a load ``(n,)``, with those beyond the window's ends."""
    n, size = (
        outline.size,
        math.sqrt(dot(outline - outline.mean(), outline - outline.mean()) / outline.size),
    )
    seen = 0
    for swing in _SWINGS:
        rows = _turning_rows(outline, swing * size)
        if not _FEWEST_TURNS <= rows.size <= _MOST_TURNS or rows.size == seen:
            continue
        seen = rows.size
        times, heights = rows.astype(np.float64), outline[rows]
        between = [np.diff(times)[j::2] for j in (0, 1)]
        cycle = sum(float(one.mean()) for one in between)
        if max(float(one.std()) for one in between) > _REPEATED * cycle:
            continue
        lengths = [float(np.median(one)) for one in between]
        levels = [float(np.median(heights[j::2])) for j in (0, 1)]
        before, after = [], []
        at, k = times[0], 0
        while at > 0.0:
            k += 1
            at -= max(1.0, lengths[k % 2])
            before.append((at, levels[k % 2]))
        at, k = times[-1], times.size - 1
        while at < n - 1.0:
            at += max(1.0, lengths[k % 2])
            k += 1
            after.append((at, levels[k % 2]))
        every = (*before[::-1], *zip(times, heights, strict=True), *after)
        yield np.array([t for t, _ in every]), np.array([h for _, h in every])


def _known_turns(of: Hypothesis) -> Iterator[tuple[Array, Array]]:
    """Turns of the wave that it has already."""
    for one in of.nuisances:
        if isinstance(one, UnevenWave):
            yield np.array(one.times), np.array(one.heights)


@kernel
def _turning_rows(load: Array, swing: float) -> Index:
    """Rows at which a load turns and goes back by a ``swing`` at least."""
    rows = np.empty(load.size, np.int64)
    count = way = high = low = 0
    for k in range(1, load.size):
        if way >= 0 and load[k] > load[high]:
            high = k
        if way <= 0 and load[k] < load[low]:
            low = k
        if way >= 0 and load[high] - load[k] > swing:
            rows[count] = high
            count, way, low = count + 1, -1, k
        elif way <= 0 and load[k] - load[low] > swing:
            rows[count] = low
            count, way, high = count + 1, 1, k
    # the first is an end of the window
    begin = 1 if count > 0 and rows[0] <= 2 else 0
    return rows[begin:count].copy()


class _Way:
    """What a wave and a process leave of PV, the noise model and the dead time held."""

    def __init__(self, case: Case, of: Hypothesis, taps: Array, at_valve: bool) -> None:
        self.case, self.of, self.at_valve = case, of, at_valve
        self.taps = np.ascontiguousarray(taps)
        self.others = without_load(of)

    def left(self, poles: Poles, course: Array) -> tuple[Array, Array]:
        """What is left ``(n,)``, whitened, and the basis ``(k, n)`` of process and columns."""
        rows, of = self.case.rows, self.of
        columns = self.case.columns(self.others, of.stem, poles, of.dead_time)
        response = poles.response(of.stem)
        basis, left = left_of_pv(rows, response, of.dead_time, columns, self.taps)
        process = poles.coefficients if self.at_valve else NO_PROCESS
        made = through_process(course[None], process)
        return left - project_out(filter_rows(made, self.taps, rows.weight)[0], basis), basis

    def turned(self, wave: _Wave, basis: Array) -> Array:
        """Change of the wave's part with each number of it, ``(p, n)``."""
        slopes = slopes_of(wave.times, wave.heights, wave.bends, self.case.rows.size)
        process = wave.poles.coefficients if self.at_valve else NO_PROCESS
        whitened = filter_rows(through_process(slopes, process), self.taps, self.case.rows.weight)
        return _beside(whitened, basis)

    def swayed(self, wave: _Wave, left: Array, free: list[int]) -> Array:
        """Change of the model with the log of each free time constant, ``(k, n)``."""
        course = self.course(wave)
        found = np.empty((len(free), left.size))
        for row, i in enumerate(free):
            steps = np.zeros((1, 3))
            steps[0, i] = _NUDGE
            nudged = wave.poles.of_row(wave.poles.moved(steps)[0])
            found[row] = (left - self.left(nudged, course)[0]) / _NUDGE
        return found

    def course(self, wave: _Wave) -> Array:
        """The load ``(n,)``."""
        found: Array = course_of(self.case.rows.size, wave.times, wave.heights, wave.bends)
        return found


def _free(poles: Poles) -> list[int]:
    """Which of the three numbers of a process move."""
    values = (poles.slow, poles.fast, poles.third)
    return [i for i in range(3) if values[i] > 0.0 and not (poles.integrating and i == 0)]


def _fit(
    case: Case,
    of: Hypothesis,
    taps: Array,
    at_valve: bool,
    wave: _Wave,
    *,
    rounds: int,
    spreads: int,
) -> _Wave:
    """Turns, bends and poles that are likeliest together; the spread of the turns in turn."""
    way = _Way(case, of, taps, at_valve)
    m, count = wave.times.size, case.rows.count
    free = _free(wave.poles)
    open_ = np.zeros((2 * m, 2 * m))
    left, basis = way.left(wave.poles, way.course(wave))
    squares = dot(left, left)
    damping = _DAMPED[0]
    for _ in range(spreads):
        spread = spread_of(wave.times, wave.heights, open_)
        precision, mean = _with_poles(precision_of(spread, wave.times[0], m, wave.bends.size), free)
        for _ in range(rounds):
            variance = squares / count + case.rows.floor
            slopes = np.vstack([way.turned(wave, basis), way.swayed(wave, left, free)])
            at = _numbers(wave, free)
            told, pull = _products(slopes, left)
            told, pull = told / variance + precision, pull / variance - precision @ at + mean
            cost = 0.5 * squares / variance + _kept_by(precision, mean, at)
            gained = 0.0
            for _ in range(_TRIES):
                damped = told + damping * np.diag(np.diag(told))
                step = solve_spd(damped, pull)
                moved = _moved(wave, step, free)
                if moved is not None:
                    new_left, new_basis = way.left(moved.poles, way.course(moved))
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
        told, _ = _products(way.turned(wave, basis), left)
        told /= squares / count + case.rows.floor
        p = told.shape[0]
        open_ = inverse_of(told + precision[:p, :p])[: 2 * m, : 2 * m]
    spread = spread_of(wave.times, wave.heights, open_)
    precision, mean = precision_of(spread, wave.times[0], m, wave.bends.size)
    price = price_of_turns(_numbers(wave, []), told, precision, mean, count)
    return replace(wave, squares=squares, price=price)


def _numbers(wave: _Wave, free: list[int]) -> Array:
    """Times, heights, bends and steps of the poles, ``(p,)``."""
    return np.concatenate([wave.times, wave.heights, wave.bends.T.ravel(), np.zeros(len(free))])


def _moved(wave: _Wave, step: Array, free: list[int]) -> _Wave | None:
    """The wave after a step of all its numbers; None where turns would pass each other."""
    m, p = wave.times.size, 2 * wave.times.size + wave.bends.size
    times = wave.times + step[:m]
    if not (np.diff(times) > _APART).all():
        return None
    steps = np.zeros((1, 3))
    step[p:] = np.clip(step[p:], -_FARTHEST, _FARTHEST)
    steps[0, free] = step[p:]
    poles = wave.poles.of_row(wave.poles.moved(steps)[0])
    if _free(poles) != free:
        return None
    bends = wave.bends + step[2 * m : p].reshape(-1, 2).T
    return replace(
        wave, times=times, heights=wave.heights + step[m : 2 * m], bends=bends, poles=poles
    )


def _with_poles(prior: tuple[Array, Array], free: list[int]) -> tuple[Array, Array]:
    """Precision and mean of a wave with those of the steps of its poles."""
    precision, mean = prior
    p, k = mean.size, len(free)
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


@kernel
def _products(slopes: Array, left: Array) -> tuple[Array, Array]:
    """Products ``(p, p)`` of rows with each other, and with a signal, ``(p,)``."""
    p = slopes.shape[0]
    gram, right = np.empty((p, p)), np.empty(p)
    for i in range(p):
        right[i] = dot(slopes[i], left)
        for j in range(i + 1):
            gram[i, j] = dot(slopes[i], slopes[j])
            gram[j, i] = gram[i, j]
    return gram, right


@kernel
def _beside(rows: Array, basis: Array) -> Array:
    """What orthonormal rows ``(k, n)`` leave of each of the rows ``(m, n)``."""
    out = np.empty(rows.shape)
    for r in range(rows.shape[0]):
        out[r] = project_out(rows[r], basis)
    return out
