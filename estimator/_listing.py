"""Compiled listing of sets of slips, each judged by the one-step criterion as it is found.

The valves of a region ``(S, J)`` that slip at the same samples as its valve of the widest stick
band are one set; what is left of the region is split and listed in turn. A set costs one walk along
OP and sums over its slips. The best few of each stick band and dead time are kept.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from estimator._kernels import Array, Index, kernel
from estimator._one_step import OneStep, cost_of_slips
from estimator._slips import BLOCK, Op, slips_into

__all__ = ["OneStepRows", "Sets", "list_sets", "list_sets_at", "sets_of", "slip_patterns"]

_DEEP = 256
_FLAT = 1e-3


class OneStepRows(NamedTuple):
    """PV's unexplained part and its orthonormal past, with the weights, for sums over slips.

    ``table`` has shape ``((n + delays) * 2 * rows,)``, sample by sample: ``rows`` columns summed
    from there to the end, the same columns themselves. ``weights`` has shape ``(2, n + delays)``,
    summed and themselves. ``energy`` is that of PV's unexplained part.
    """

    table: Array
    weights: Array
    rows: int
    delays: int
    energy: float


class Sets(NamedTuple):
    """The best sets of each stick band (by bins of ``width``) and dead time, best first.

    ``cost`` has shape ``(bins, delays, kept)``, infinite where none; ``region``
    ``(bins, delays, kept, 6)``: ends of S, ends of J, lead and direction of the first slip.
    """

    width: float
    cost: Array
    region: Array


def sets_of(width: float, widest: float, delays: int, kept: int) -> Sets:
    """Room for sets up to a stick band ``widest``."""
    shape = int(widest / width) + 2, delays, kept
    return Sets(width, np.full(shape, np.inf), np.empty((*shape, 6)))


@kernel
def _walk(
    op: Op, band: float, jump: float, lead: float, first: float, at: Index, way: Array, turn: Array
) -> tuple[int, float, float]:
    """Slips of one valve, and how far OP came back and went on between them without another.

    Slip ``i`` is at sample ``at[i]``; it changes the stem by ``way[i] - turn[i] fD``. Valves of a
    stick band and a slip jump down to the returned ways slip at the same samples. No slips where
    the first one is not in the direction ``first``, or where no valve could stand like that.
    """
    if lead > band + jump:
        return 0, -1.0, -1.0
    s = -first
    h = op.u[0] - first * (band - lead)
    up = h + (jump if s > 0.0 else band)
    down = h - (band if s > 0.0 else jump)
    back, on = 0.0, 0.0
    count = 0
    for b in range(op.top.size):
        top, bottom = op.top[b], op.bottom[b]
        if top <= up and bottom >= down:
            if count > 0:
                back = max(back, h - bottom if s > 0.0 else top - h)
                on = max(on, top - h if s > 0.0 else h - bottom)
            continue
        for k in range(BLOCK * b, min(BLOCK * b + BLOCK, op.u.size)):
            v = op.u[k]
            if v > up or v < down:
                now = 1.0 if v > up else -1.0
                if count == 0 and now != first:
                    return 0, -1.0, -1.0
                at[count], way[count], turn[count] = k, v - h, now - s
                count += 1
                h, s = v, now
                up = h + (jump if s > 0.0 else band)
                down = h - (band if s > 0.0 else jump)
            elif count > 0:
                back, on = max(back, s * (h - v)), max(on, s * (v - h))
    return count, back, on


@kernel
def _insert(sets: Sets, bin_: int, delay: int, cost: float, region: Array) -> None:
    """Put a set among the best of its bin."""
    costs, regions = sets.cost[bin_, delay], sets.region[bin_, delay]
    place = costs.size - 1
    while place > 0 and costs[place - 1] > cost:
        costs[place] = costs[place - 1]
        regions[place] = regions[place - 1]
        place -= 1
    costs[place] = cost
    regions[place] = region


@kernel
def _cost(
    table: Any,
    weights: Any,
    rows: OneStepRows,
    delay: int,
    at: Index,
    way: Array,
    turn: Array,
    slips: int,
    friction: float,
    sums: Any,
    gram: Any,
    cost: Any,
) -> None:
    """Costs of one set of slips at ``cost.size`` dead times, the first one ``delay``."""
    delays, width = cost.size, 2 * rows.rows
    wide = width * delays
    real = sums.dtype.type
    sums[:] = real(0.0)
    gram[:] = real(0.0)
    g11, g12, g22 = gram[0], gram[1], gram[2]
    x = 0.0
    for m in range(slips):
        step = way[m] - turn[m] * friction
        now = x + step
        # slices, because a compiler that must think of negative indices uses no SIMD lanes
        k = at[m] + delay
        row = table[k * width : k * width + wide]
        c = real(step)
        for i in range(wide):
            sums[i] += c * row[i]
        square, cross, own = real(now * now - x * x), real(step * now), real(step * step)
        left, weight = weights[0, k : k + delays], weights[1, k : k + delays]
        for d in range(delays):
            g11[d] += square * left[d]
            g12[d] += cross * weight[d]
            g22[d] += own * weight[d]
        x = now
    for d in range(delays):
        level, moved = sums[d * width :], sums[d * width + rows.rows :]
        h11, h12, h22 = g11[d], g12[d], g22[d]
        for r in range(1, rows.rows):
            h11 -= level[r] * level[r]
            h12 -= level[r] * moved[r]
            h22 -= moved[r] * moved[r]
        if h11 > real(_FLAT) * g11[d] and h22 > real(0.0):
            share = real(1.0) / h11
            rest = moved[0] - h12 * share * level[0]
            own = max(h22 - h12 * h12 * share, real(_FLAT) * h22)
            cost[d] = real(rows.energy) - level[0] * level[0] * share - rest * rest / own
        else:
            cost[d] = real(np.inf)


@kernel
def _next_set(
    op: Op,
    stack: Array,
    height: int,
    start: Array,
    least: Array,
    at: Index,
    way: Array,
    turn: Array,
    found: Array,
) -> tuple[int, int]:
    """Take one region of the ``stack``, put back what else it holds; the new height, and slips.

    The slips of its widest stick band are put into ``at``, ``way`` and ``turn`` as :func:`_walk`
    does, and the ends of S and J of the valves that slip so into ``found``.
    """
    height -= 1
    s0, s1, j0, j1 = stack[height]
    j1 = min(j1, s1)
    if s1 <= s0 or j1 < j0 - 1e-9:
        return height, 0
    slips, back, on = _walk(op, s1, j1, start[0], start[1], at, way, turn)
    if slips == 0:
        return height, 0
    s_end, j_end = max(s0, min(back, s1 - least[0])), max(j0, min(on, j1 - least[1]))
    if s_end > s0 and height < _DEEP - 2:
        stack[height] = (s0, s_end - 1e-12, j0, j1)
        height += 1
    if j_end > j0 and height < _DEEP - 2:
        stack[height] = (s_end, s1, j0, j_end - 1e-12)
        height += 1
    found[0], found[1], found[2], found[3] = s_end, s1, j_end, j1
    return height, slips


@kernel
def _list(
    op: Op,
    table: Any,
    weights: Any,
    rows: OneStepRows,
    delays: int,
    firsts: Index,
    regions: Array,
    starts: Array,
    least: Array,
    most: int,
    sets: Sets,
) -> None:
    at, way, turn = np.empty(op.u.size, np.int64), np.empty(op.u.size), np.empty(op.u.size)
    sums = np.empty(2 * rows.rows * delays, table.dtype)
    gram, cost = np.empty((3, delays), table.dtype), np.empty(delays, table.dtype)
    stack, region = np.empty((_DEEP, 4)), np.empty(6)
    last = sets.cost.shape[2] - 1
    listed = 0
    for i in range(starts.shape[0]):
        stack[0] = regions[i]
        delay, height = firsts[i], 1
        region[4], region[5] = starts[i]
        while height > 0 and listed < most:
            height, slips = _next_set(op, stack, height, starts[i], least, at, way, turn, region)
            listed += min(slips, 1)
            if slips < 2:
                continue
            friction = 0.5 * (region[1] - 0.5 * (region[2] + region[3]))
            _cost(table, weights, rows, delay, at, way, turn, slips, friction, sums, gram, cost)
            bin_ = min(int(region[1] / sets.width), sets.cost.shape[0] - 1)
            for d in range(delays):
                if cost[d] < sets.cost[bin_, delay - 1 + d, last]:
                    _insert(sets, bin_, delay - 1 + d, cost[d], region)


@kernel
def list_sets(
    op: Op, rows: OneStepRows, regions: Array, starts: Array, least: Array, most: int, sets: Sets
) -> None:
    """List the sets of slips of ``regions`` at every dead time from 1 on, into ``sets``.

    ``regions`` has shape ``(m, 4)``: ends of S, ends of J; ``starts`` ``(m, 2)``: lead and
    direction of the first slip. Sets that differ within ``least`` (in S, in J) count as one. At
    most ``most`` are listed.
    """
    # half the digits, twice the lanes: enough to rank
    table, weights = rows.table.astype(np.float32), rows.weights.astype(np.float32)
    firsts = np.ones(starts.shape[0], np.int64)
    _list(op, table, weights, rows, rows.delays, firsts, regions, starts, least, most, sets)


@kernel
def list_sets_at(
    op: Op,
    rows: OneStepRows,
    delays: Index,
    regions: Array,
    starts: Array,
    least: Array,
    most: int,
    sets: Sets,
) -> None:
    """The same for regions that have one dead time each, ``delays`` of shape ``(m,)``."""
    _list(op, rows.table, rows.weights, rows, 1, delays, regions, starts, least, most, sets)


@kernel
def slip_patterns(
    op: Op,
    tables: OneStep,
    regions: Array,
    starts: Array,
    least: Array,
    widest: float,
    most: int,
    exact: bool,
) -> tuple[Array, Array, Index, Array]:
    """All valves of regions that slip differently, as smaller regions, each judged by one of them.

    Arguments as of :func:`list_sets`. A region slips like its valve of the widest stick band,
    except for differences within ``least``; it is no wider than ``widest`` in J, because the stem
    still depends on J. At most ``most`` come back: ends of S and of J ``(m, 4)``; S, J and lead of
    the valve that stands for it ``(m, 3)``; the row of ``regions`` it belongs to, and the one-step
    cost of the valve, infinite where it slips once only, ``(m,)`` each. Unless that is to be
    ``exact``, the valve is taken to slip like its region, which saves another walk along OP.
    """
    at, way, turn = np.empty(op.u.size, np.int64), np.empty(op.u.size), np.empty(op.u.size)
    step, sums = np.empty(op.u.size), np.empty(3 * tables.rows)
    found, nodes, of = np.empty((most, 4)), np.empty((most, 3)), np.empty(most, np.int64)
    cost = np.full(most, np.inf)
    stack, region = np.empty((_DEEP, 4)), np.empty(4)
    count = 0
    for i in range(starts.shape[0]):
        stack[0] = regions[i]
        height = 1
        while height > 0 and count < most:
            height, slips = _next_set(op, stack, height, starts[i], least, at, way, turn, region)
            if slips == 0:
                continue
            s0, s1, j0, j1 = region
            parts = max(1, int(np.ceil((j1 - j0) / widest)))
            for part in range(min(parts, most - count)):
                low, high = j0 + (j1 - j0) * part / parts, j0 + (j1 - j0) * (part + 1) / parts
                jump = min(0.5 * (low + high), s1)
                found[count] = (s0, s1, low, high)
                nodes[count] = (s1, jump, starts[i, 0])
                of[count] = i
                if exact:
                    slips = slips_into(op, s1, jump, starts[i, 0], starts[i, 1], at, step)
                else:
                    friction = 0.5 * (s1 - jump)
                    for m in range(slips):
                        step[m] = way[m] - turn[m] * friction
                if slips > 1:
                    cost[count], _ = cost_of_slips(tables, at, step, slips, sums)
                count += 1
    return found[:count], nodes[:count], of[:count], cost[:count]
