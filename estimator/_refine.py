"""Compiled zooms of the simulation criterion: valve, dead time and poles together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator._kernels import Array, Index, filtered, kernel
from estimator._response import Basis, Simulated, ordered_poles, shared_rows, simulated_tables
from estimator._simulated import costs_of_slips
from estimator._slips import Op, offset_of, slips_into, valves_around

__all__ = ["Search", "refine_process", "refine_simulated"]

_MOST = 0.99999
_NEIGHBOURS = 10
_FLAT = 1e-6


class Search(NamedTuple):
    """How to zoom: passes, dead times, how far a dead time may move, shrinking of each width."""

    passes: int
    shortest: int
    longest: int
    reach: int
    shrink: Array


class _Work(NamedTuple):
    """Room for the sums of one stem."""

    sums: Array
    squares: Array
    cost: Array
    gain: Array


@kernel
def _work(rows: int, lags: int) -> _Work:
    return _Work(np.empty(rows * lags), np.empty(lags), np.empty(lags), np.empty(lags))


@kernel
def _tried(
    tables: Simulated,
    at: Index,
    step: Array,
    count: int,
    lag: int,
    lags: int,
    work: _Work,
    best: Array,
    valve: tuple[float, float, float],
) -> bool:
    """Put a valve (S, J, lead) with these slips and its best dead time into ``best`` if better."""
    if valve[0] <= 0.0 or count < 2:
        return False
    costs_of_slips(
        tables, at, step, count, lag, lags, work.sums, work.squares, work.cost, work.gain
    )
    found = False
    for d in range(lags):
        if work.cost[d] < best[0]:
            best[0], best[5] = work.cost[d], lag + d
            best[1], best[2], best[3] = valve
            found = True
    return found


@kernel
def _box(
    op: Op,
    tables: Simulated,
    best: Array,
    half: Array,
    boxes: Index,
    lag: int,
    lags: int,
    work: _Work,
    at: Index,
    step: Array,
) -> None:
    """The best valve and dead time of boxes around ``best``, one after the other, put into it."""
    for counts in boxes:
        for band, jump, lead in valves_around(best[1:4].copy(), half, counts):
            count = slips_into(op, band, jump, lead, best[4], at, step)
            _tried(tables, at, step, count, lag, lags, work, best, (band, jump, lead))


@kernel
def _moved(pole: float, factor: float) -> float:
    """The pole of a time constant ``factor`` times as long."""
    if pole <= 0.0 or pole >= 1.0:
        return pole
    return min(float(np.exp(np.log(pole) / factor)), _MOST)


@kernel
def _neighbour(number: int, slow: float, fast: float, factor: float) -> tuple[float, float]:
    """The poles of a neighbouring process, slower first; equal to the given ones where none.

    Each time constant is divided by ``factor``, kept, or multiplied; one lag may grow a second, a
    fifth as slow.
    """
    if number == 9:
        if fast == 0.0 and 0.0 < slow < 1.0:
            fast = _moved(slow, 0.2)
        return slow, fast
    a = _moved(slow, factor ** (number % 3 - 1))
    b = _moved(fast, factor ** (number // 3 - 1))
    if (number % 3 != 1 and a == slow) or (number // 3 != 1 and b == fast):
        return slow, fast
    return max(a, b), min(a, b)


@kernel
def refine_simulated(
    op: Op, basis: Basis, best: Array, half: Array, boxes: Index, search: Search
) -> None:
    """Zoom in on valve, dead time and poles from ``best``, and put what is found into it.

    ``best`` holds cost, S, J, lead, direction of the first slip, dead time, slow and fast pole;
    ``half`` the half-widths in S, J, lead and in the logarithm of the time constants, narrowed in
    place by each pass. A pass looks at the valves of ``boxes`` (`valves_around`), ``(k, 3)``, one
    after the other.
    """
    n, line = op.u.size, boxes[0, 0]
    reach, pad = search.reach, search.longest + 1
    at, step = np.empty(n, np.int64), np.empty(n)
    # slips of the stick bands around the best valve, which all neighbouring processes share
    near_at, near_step = np.empty((line, n), np.int64), np.empty((line, n))
    near_count, near_band = np.zeros(line, np.int64), np.empty(line)
    work = _work(basis.slope.shape[0] + 2, 2 * reach + 1)
    for _ in range(search.passes):
        lag = max(search.shortest, int(best[5]) - reach)
        lags = min(search.longest, int(best[5]) + reach) - lag + 1
        tables = simulated_tables(basis, best[6], best[7], pad)
        _box(op, tables, best, half, boxes, lag, lags, work, at, step)
        jump0, lead0 = best[2], best[3]
        for a in range(line):
            near_band[a] = best[1] + half[0] * offset_of(a, line)
            near_count[a] = slips_into(
                op, near_band[a], min(jump0, near_band[a]), lead0, best[4], near_at[a], near_step[a]
            )
        slow, fast = best[6], best[7]
        for i in range(_NEIGHBOURS):
            p, q = _neighbour(i, slow, fast, np.exp(half[3]))
            if p == slow and q == fast:
                continue
            near = simulated_tables(basis, p, q, pad)
            lag = max(search.shortest, int(best[5]) - reach)
            lags = min(search.longest, int(best[5]) + reach) - lag + 1
            for a in range(line):
                valve = near_band[a], min(jump0, near_band[a]), lead0
                count = near_count[a]
                if _tried(near, near_at[a], near_step[a], count, lag, lags, work, best, valve):
                    best[6], best[7] = p, q
        for axis in range(4):
            half[axis] *= search.shrink[axis]
        reach = min(reach, 1)


@kernel
def _process_costs(
    basis: Basis, stem: Array, slow: float, fast: float, lag: int, lags: int, cost: Array
) -> None:
    """Costs of a process for a known stem, for dead times from ``lag`` on."""
    n, order = stem.size, basis.taps.size
    integrating = slow >= 1.0
    slow, fast = ordered_poles(slow, fast)
    rows = shared_rows(basis, fast if integrating else slow, integrating)
    keep = 1.0 if integrating else slow
    take = 1.0 / n if integrating else 1.0 - slow
    response = np.empty(n)
    one = two = 0.0
    for k in range(n):
        one = keep * one + take * (stem[k] - stem[0])
        two = fast * two + (1.0 - fast) * one
        response[k] = two
    if order > 1:
        response = filtered(response, basis.taps, 0.0)
    energy = 0.0
    for k in range(n):
        energy += rows[0, k] * rows[0, k]
    for d in range(lags):
        # slices, because a compiler that must think of negative indices uses no SIMD lanes
        late, weight = response[: n - lag - d], basis.weight[lag + d :]
        square = 0.0
        for k in range(late.size):
            square += weight[k] * late[k] * late[k]
        left, product = square, 0.0
        for r in range(rows.shape[0]):
            row = rows[r, lag + d :]
            total = 0.0
            for k in range(late.size):
                total += row[k] * late[k]
            if r == 0:
                product = total
            else:
                left -= total * total
        saved = product * product / left if left > _FLAT * square + 1e-12 else 0.0
        cost[d] = max(energy - saved, 1e-12 * energy + 1e-300)


@kernel
def refine_process(basis: Basis, stem: Array, best: Array, width: float, search: Search) -> None:
    """Zoom in on dead time and poles for a known stem; ``best`` as in :func:`refine_simulated`."""
    cost = np.empty(search.longest + 1)
    for _ in range(search.passes):
        slow, fast = best[6], best[7]
        for i in (4, 1, 3, 5, 7, 2, 6, 9):
            a, b = _neighbour(i, slow, fast, np.exp(width))
            if a == slow and b == fast and i != 4:
                continue
            lag = max(search.shortest, int(best[5]) - search.reach)
            lags = min(search.longest, int(best[5]) + search.reach) - lag + 1
            _process_costs(basis, stem, a, b, lag, lags, cost)
            for d in range(lags):
                if cost[d] < best[0]:
                    best[0], best[5], best[6], best[7] = cost[d], lag + d, a, b
        width *= search.shrink[3]
