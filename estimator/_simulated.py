"""Compiled sums of the simulation criterion: a valve's cost and gain, by dead time."""

from __future__ import annotations

import numpy as np

from estimator._kernels import Array, Index, kernel
from estimator._response import Simulated
from estimator._slips import Op, slips_into

__all__ = ["costs_of_slips", "simulated_coarse", "simulated_costs", "simulated_steps"]

_FLAT = 1e-6


@kernel
def costs_of_slips(
    tables: Simulated,
    at: Index,
    step: Array,
    count: int,
    lag: int,
    lags: int,
    sums: Array,
    squares: Array,
    cost: Array,
    gain: Array,
) -> None:
    """Costs and gains of the stem whose slips are given, for dead times from ``lag`` on.

    ``sums`` has shape ``(lags * rows,)`` at least, the others ``(lags,)``.
    """
    rows = tables.rows
    order = tables.close.shape[0]
    wide = lags * rows
    sums[:wide] = 0.0
    squares[:lags] = 0.0
    z0 = z1 = z2 = 0.0
    before = 0
    constant, slow, fast, own = tables.own[0], tables.own[1], tables.own[2], tables.own[3]
    for i in range(count):
        t, c = at[i], step[i]
        gap = t - before
        if tables.integrating:
            z0 += gap * z1
        else:
            z1 *= tables.decay[0, gap]
        z2 *= tables.decay[1, gap]
        before = t
        t += lag
        # slices, because a compiler that must think of negative indices uses no SIMD lanes
        row = tables.shared[t * rows : t * rows + wide]
        for k in range(wide):
            sums[k] += c * row[k]
        two0, two1, two2, once = 2.0 * c * z0, 2.0 * c * z1, 2.0 * c * z2, c * c
        e0, e1 = constant[t : t + lags], slow[t : t + lags]
        e2, e3 = fast[t : t + lags], own[t : t + lags]
        for d in range(lags):
            squares[d] += two0 * e0[d] + two1 * e1[d] + two2 * e2[d] + once * e3[d]
        if order > 1:
            j = i - 1
            while j >= 0 and at[i] - at[j] < order:
                near = tables.close[at[i] - at[j], t : t + lags]
                both = 2.0 * c * step[j]
                for d in range(lags):
                    squares[d] += both * near[d]
                j -= 1
        z0 += c * tables.modes[0]
        z1 += c * tables.modes[1]
        z2 += c * tables.modes[2]
    for d in range(lags):
        left = squares[d]
        for r in range(1, rows):
            left -= sums[d * rows + r] * sums[d * rows + r]
        product = sums[d * rows]
        gain[d] = product / left if left > _FLAT * squares[d] + 1e-12 else 0.0
        cost[d] = max(tables.energy - gain[d] * product, 1e-12 * tables.energy + 1e-300)


@kernel
def simulated_costs(
    op: Op, tables: Simulated, nodes: Array, first: float, lag: int, lags: int
) -> tuple[Array, Array]:
    """Costs and gains, ``(lags, m)``, of the valves ``nodes``, ``(m, 3)``: S, J and lead."""
    m = nodes.shape[0]
    at, step = np.empty(op.u.size, np.int64), np.empty(op.u.size)
    sums, squares = np.empty(tables.rows * lags), np.empty(lags)
    cost, gain = np.full((lags, m), np.inf), np.zeros((lags, m))
    one, slope = np.empty(lags), np.empty(lags)
    for j in range(m):
        count = slips_into(op, nodes[j, 0], nodes[j, 1], nodes[j, 2], first, at, step)
        if count >= 2:
            costs_of_slips(tables, at, step, count, lag, lags, sums, squares, one, slope)
            cost[:, j] = one
            gain[:, j] = slope
    return cost, gain


@kernel
def simulated_steps(
    tables: Simulated, at: Index, step: Array, lag: int, lags: int
) -> tuple[Array, Array]:
    """Costs and gains, ``(lags,)``, of the stem that changes by ``step`` at the samples ``at``."""
    cost, gain = np.empty(lags), np.empty(lags)
    sums, squares = np.empty(tables.rows * lags), np.empty(lags)
    costs_of_slips(tables, at, step, at.size, lag, lags, sums, squares, cost, gain)
    return cost, gain


@kernel
def simulated_coarse(
    op: Op, tables: tuple[Simulated, ...], valves: Array, lags: int, most: int
) -> Array:
    """Costs ``(structures, lags, m)`` of the valves ``(m, 4)``: S, J, lead, first direction.

    Dead times run from 0. Infinite for a valve that slips more than ``most`` times.
    """
    m = valves.shape[0]
    at, step = np.empty(op.u.size, np.int64), np.empty(op.u.size)
    widest = 0
    for i in range(len(tables)):
        widest = max(widest, tables[i].rows)
    sums, squares = np.empty(widest * lags), np.empty(lags)
    one, slope = np.empty(lags), np.empty(lags)
    out = np.full((len(tables), lags, m), np.inf)
    for j in range(m):
        band, jump, lead, first = valves[j]
        count = slips_into(op, band, jump, lead, first, at, step)
        if count < 2 or count > most:
            continue
        for i in range(len(tables)):
            costs_of_slips(tables[i], at, step, count, 0, lags, sums, squares, one, slope)
            out[i, :, j] = one
    return out
