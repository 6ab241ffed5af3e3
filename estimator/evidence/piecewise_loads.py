"""A load of steps and straight lines, looked for corner by corner.

Beside a healthy valve such a load is the closest thing to a sticky one that no period tells: OP
answers it with ramps, PV with what is left of them. A process that was fitted without the load is
wrong, so that the load is looked for with several, and process, noise and load then in turn.

The corners are found by orthogonal matching pursuit (Pati, Rezaiifar and Krishnaprasad, 1993): of
all steps and slopes, at every row, the one that takes most from what is left of PV, again and
again. What PV has in common with all of them comes from one pass of the adjoint filter.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from compiled import kernel
from estimator.algebra import dot, filter_rows
from estimator.arrays import Array, Index
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.linear_fit import left_of_pv
from estimator.hypotheses.noise import DRIFT_AND_NOISE
from estimator.hypotheses.nuisances import Nuisance
from estimator.hypotheses.piecewise_load import (
    CORNER_PRICE,
    NO_PROCESS,
    Corner,
    PiecewiseLoad,
    course_of_corners,
    load_response,
)
from estimator.hypotheses.uneven_wave import UnevenWave
from estimator.processes.poles import Poles, Shape
from estimator.search.processes import polish

__all__ = ["fit_piecewise_loads", "outline_load", "without_load"]

_LAGS, _DEAD_TIMES = (3.0, 8.0, 20.0), (1, 6)
"""Lags and dead times, in samples, with which it is looked for beside those of the starts."""
_FOLLOWED = 3
"""Of all starts, those that are fitted in turn."""
_TURNS = 5
"""Load and process are fitted in turn, at most so often."""
_GAINED = 0.5
"""Nats of a turn below which it was the last."""
_MOST_CORNERS = 60
"""Corners at most: of a load that has more, noise is the better model."""
_PATIENCE = 8
"""Corners in a row that may leave the load not worth its price: one side of a wave pays little."""
_LAST = 4
"""Rows at the end of the window at which no corner is looked for."""
_APART = 1e-4
"""Share of a corner's own energy that the others must leave of it, or it is one of them."""
_TIE = 1e-9
"""Relative gain below which two corners are the same: rounding decides nothing."""
_SLOPE, _STEP = 0, 1


def fit_piecewise_loads(
    case: Case, starts: tuple[Hypothesis, ...], least: float, *, valve: bool = False
) -> list[Hypothesis]:
    """The valve with a load of steps and lines, found from some processes, the likeliest first.

    ``starts`` are hypotheses whose processes it begins from. With ``valve`` each keeps its sticky
    valve and what else is beside it, otherwise the valve is healthy. Those that are not as likely
    as ``least`` before their process is fitted are left out.
    """
    found: list[Hypothesis] = []
    for start, taps in _starts(case, starts, valve):
        for enters in (True, False):
            load = _best_load(case, start, taps, enters)
            if load is not None:
                found.append(_with(case, start, load, taps))
    found.sort(key=lambda one: -round(one.likelihood, 6))
    ends = [_in_turn(case, one) for one in found[:_FOLLOWED] if one.likelihood > least]
    return sorted(ends, key=lambda one: -round(one.likelihood, 6))


def _starts(
    case: Case, starts: tuple[Hypothesis, ...], valve: bool
) -> Iterator[tuple[Hypothesis, Array]]:
    """Processes to begin from, each with a noise model."""
    if valve:
        for one in starts:
            yield one, one.taps
        return
    for one in starts:
        yield replace(one, valve=None, stem=case.rows.u, nuisances=()), DRIFT_AND_NOISE
    for slow in _LAGS:
        for dead_time in _DEAD_TIMES:
            if dead_time <= case.max_dead_time:
                poles = Poles(Shape.LAGS, slow)
                at = replace(starts[0], poles=poles, dead_time=dead_time)
                yield replace(at, valve=None, stem=case.rows.u, nuisances=()), DRIFT_AND_NOISE


def _in_turn(case: Case, start: Hypothesis) -> Hypothesis:
    """Load and process fitted in turn."""
    best = None
    at = start
    for turn in range(_TURNS):
        found = polish(case, at.valve, at, at.nuisances, at.taps, wide=turn == 0)
        if best is not None and found.likelihood <= best.likelihood + _GAINED:
            break
        best = found
        load = _best_load(case, best, best.taps, _enters_at_valve(best))
        if load is None:
            break
        at = _with(case, best, load, best.taps)
    assert best is not None
    return best


def _enters_at_valve(of: Hypothesis) -> bool:
    return any(isinstance(one, PiecewiseLoad) and one.through is not None for one in of.nuisances)


def _with(case: Case, of: Hypothesis, load: PiecewiseLoad, taps: Array) -> Hypothesis:
    """The hypothesis with a load in place of what it had of them."""
    nuisances = (*without_load(of), load)
    return case.fit(of.valve, of.poles, of.dead_time, nuisances, taps, stem=of.stem)


def without_load(of: Hypothesis) -> tuple[Nuisance, ...]:
    """What it has beside loads of any course."""
    return tuple(one for one in of.nuisances if not isinstance(one, PiecewiseLoad | UnevenWave))


def _best_load(case: Case, of: Hypothesis, taps: Array, at_valve: bool) -> PiecewiseLoad | None:
    """The load that takes most from PV for its price, with this process and noise model."""
    price = CORNER_PRICE * math.log(case.rows.count)
    corners = _corners(case, of, taps, at_valve, price)
    return PiecewiseLoad(corners, of.poles if at_valve else None) if corners else None


def outline_load(case: Case, of: Hypothesis, at_valve: bool, price: float) -> Array:
    """The course ``(n,)`` of the load that takes most from PV where a corner costs ``price`` nats.

    It enters at the valve or at PV; zero where no corner is worth that.
    """
    return course_of_corners(_corners(case, of, of.taps, at_valve, price), case.rows.size)


def _corners(
    case: Case, of: Hypothesis, taps: Array, at_valve: bool, price: float
) -> tuple[Corner, ...]:
    rows = case.rows
    columns = case.columns(without_load(of), of.stem, of.poles, of.dead_time)
    taps, response = np.ascontiguousarray(taps), of.poles.response(of.stem)
    basis, left = left_of_pv(rows, response, of.dead_time, columns, taps)
    process = of.poles.coefficients if at_valve else NO_PROCESS
    places, sizes = _pursue(left, basis, taps, rows.weight, process, price, rows.count)
    return tuple(
        Corner(int(row), float(size), 0.0) if kind == _SLOPE else Corner(int(row), 0.0, float(size))
        for (row, kind), size in zip(places, sizes, strict=True)
    )


@kernel
def _pursue(
    left: Array,
    basis: Array,
    taps: Array,
    weight: Array,
    process: tuple[float, float, float, float],
    price: float,
    count: float,
) -> tuple[Index, Array]:
    """Rows and kinds ``(k, 2)`` of the corners that are worth most, and their sizes ``(k,)``.

    Args:
        left: what the basis leaves of PV, whitened, ``(n,)``.
        basis: orthonormal rows of all else, ``(m, n)``.
        taps, weight: noise model and judged rows.
        process: that the load goes through.
        price: of a corner, in nats.
        count: judged rows.
    """
    n, m = left.size, basis.shape[0]
    left = left.copy()
    shapes = _shapes(taps, process, n)
    energies = _energies(shapes, weight)
    own = energies.copy()
    span = np.zeros((m + _MOST_CORNERS, n))
    span[:m] = basis
    for i in range(m):
        _take_out(own, _in_common(basis[i], taps, weight, process))
    places = np.zeros((_MOST_CORNERS, 2), np.int64)
    factors, shares = np.zeros((_MOST_CORNERS, _MOST_CORNERS)), np.zeros(_MOST_CORNERS)
    whole = dot(left, left)
    best, worth = 0, 0.0
    for i in range(_MOST_CORNERS):
        row, kind = _best_corner(_in_common(left, taps, weight, process), own, energies)
        if row < 0:
            break
        mine = span[m + i]
        for k in range(row, n):
            mine[k] = shapes[kind, k - row] * weight[k]
        for _ in range(2):
            for j in range(m + i):
                share = dot(span[j], mine)
                for k in range(n):
                    mine[k] -= share * span[j, k]
                if j >= m:
                    factors[j - m, i] += share
        size = math.sqrt(dot(mine, mine))
        if not size > 0.0:
            break
        for k in range(n):
            mine[k] /= size
        places[i, 0], places[i, 1], factors[i, i] = row, kind, size
        shares[i] = dot(mine, left)
        for k in range(n):
            left[k] -= shares[i] * mine[k]
        _take_out(own, _in_common(mine, taps, weight, process))
        rest = dot(left, left)
        if not rest > 0.0:
            break
        nats = 0.5 * count * math.log(whole / rest) - price * (i + 1)
        if nats > worth:
            best, worth = i + 1, nats
        if i + 1 - best >= _PATIENCE:
            break
    sizes = np.zeros(best)
    for i in range(best - 1, -1, -1):
        sizes[i] = shares[i]
        for j in range(i + 1, best):
            sizes[i] -= factors[i, j] * sizes[j]
        sizes[i] /= factors[i, i]
    return places[:best].copy(), sizes


@kernel
def _shapes(taps: Array, process: tuple[float, float, float, float], n: int) -> Array:
    """What a slope and a step of one from the first row on leave in whitened PV, ``(2, n)``."""
    loads = np.ones((2, n))
    for k in range(n):
        loads[_SLOPE, k] = k + 1.0
    for kind in range(2):
        loads[kind] = load_response(loads[kind], process)
    return filter_rows(loads, taps, np.ones(n))


@kernel
def _energies(shapes: Array, weight: Array) -> Array:
    """Sums of squares ``(2, n)`` over the judged rows of shapes that begin at each row."""
    n = weight.size
    out = np.empty(shapes.shape)
    for kind in range(shapes.shape[0]):
        total = 0.0
        for k in range(n - 1, -1, -1):
            total += shapes[kind, n - 1 - k] ** 2
            out[kind, k] = total
        for j in range(n):
            if weight[j] == 0.0:
                for k in range(j + 1):
                    out[kind, k] -= shapes[kind, j - k] ** 2
    return out


@kernel
def _in_common(
    signal: Array, taps: Array, weight: Array, process: tuple[float, float, float, float]
) -> Array:
    """Products ``(2, n)`` of a signal with the slope and the step that begin at each row.

    The filters of noise model and process, backwards in time, and sums to the end.
    """
    n = signal.size
    c1, c2, third, gain = process
    out = np.empty((2, n))
    v1 = v2 = w = steps = slopes = 0.0
    for k in range(n - 1, -1, -1):
        x = signal[k] * weight[k]
        for i in range(min(taps.size, n - 1 - k)):
            x -= taps[i] * signal[k + 1 + i] * weight[k + 1 + i]
        v = c1 * v1 + c2 * v2 + gain * x
        v2 = v1
        v1 = v
        w = third * w + (1.0 - third) * v
        steps += w
        slopes += steps
        out[_SLOPE, k], out[_STEP, k] = slopes, steps
    return out


@kernel
def _take_out(own: Array, common: Array) -> None:
    """Take what corners have in common with a row of the span out of their energies."""
    for kind in range(own.shape[0]):
        for k in range(own.shape[1]):
            own[kind, k] -= common[kind, k] * common[kind, k]


@kernel
def _best_corner(common: Array, own: Array, energies: Array) -> tuple[int, int]:
    """Row and kind of the corner that takes most; -1 where none is left."""
    most, row, kind = 0.0, -1, _SLOPE
    for which in range(own.shape[0]):
        for k in range(1, own.shape[1] - _LAST):
            if own[which, k] > _APART * energies[which, k] and own[which, k] > 0.0:
                taken = common[which, k] * common[which, k] / own[which, k]
                if taken > most * (1.0 + _TIE):
                    most, row, kind = taken, k, which
    return row, kind
