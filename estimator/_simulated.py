"""Compiled sums of the simulation criterion: gain and offset eliminated, per valve and dead time.

The response of two lags to a step is a sum of three modes: a constant (or, for an integrator, a
ramp besides) and two exponentials. Between slips the response of a stem is such a sum as well, so
its energy over all later samples, weights and noise filter included, is a product of the modes with
a table made once per process; and its products with PV and with the columns that all candidates
share are sums of table entries at the slips.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator._slips import Array, Index, Op, kernel, offset_of, slips_into

__all__ = [
    "Basis",
    "Search",
    "Simulated",
    "refine_process",
    "refine_simulated",
    "simulated_coarse",
    "simulated_costs",
    "simulated_steps",
    "simulated_tables",
]

_FLAT = 1e-6
_APART = 1e-3
_LEAST, _MOST = 0.02, 0.99999


class Basis(NamedTuple):
    """What does not depend on the process: PV and the shared columns of a window.

    ``target`` is PV, whitened and weighted, ``(n,)``; ``level`` and ``slope`` hold orthonormal
    shared columns without and with the straight line of an integrator, ``(k, n)``; ``weight`` is
    ``(n,)``; ``taps`` the noise filter, ``(1,)`` for none.
    """

    target: Array
    level: Array
    slope: Array
    weight: Array
    taps: Array


class Simulated(NamedTuple):
    """Tables of one process.

    ``table`` has shape ``(rows + 4, n + pad)``: PV's unexplained part and the orthonormal shared
    columns, each summed against the response to a step at a sample; then the energy of each mode
    and of the step response itself against that response. ``close`` corrects the energy for slips
    nearer to each other than the noise filter is long. ``decay`` holds the powers of both poles.
    """

    table: Array
    rows: int
    close: Array
    decay: Array
    integrating: bool
    modes: Array
    energy: float


class Search(NamedTuple):
    """How to zoom: passes, dead times, how far a dead time may move, shrinking of each width."""

    passes: int
    shortest: int
    longest: int
    reach: int
    shrink: Array


@kernel
def simulated_tables(basis: Basis, slow: float, fast: float, pad: int) -> Simulated:
    """Tables for a process of poles ``slow >= fast`` (0 is no lag, ``slow = 1`` an integrator)."""
    n, order = basis.target.size, basis.taps.size
    integrating = slow >= 1.0
    # a lag of a quarter of a sample is none, and its powers would leave the number range
    slow, fast = (slow if slow > _LEAST else 0.0), (fast if fast > _LEAST else 0.0)
    if slow == 0.0:
        fast = 0.0
    elif not integrating and slow - fast < _APART * (1.0 - slow):
        fast = slow - _APART * (1.0 - slow)
    rows = _rows(basis, slow, fast, integrating)
    modes, response = _step_response(basis.taps, slow, fast, integrating, n)
    table = np.zeros((rows.shape[0] + 4, n + pad))
    _against_steps(rows, basis.taps, slow, fast, integrating, table)
    second = 0.0 if integrating else slow
    close = np.zeros((order, n + pad))
    _energies(basis.weight, modes, response, order, second, fast, integrating, table, close)
    decay = np.ones((2, n + 1))
    for k in range(1, n + 1):
        decay[0, k] = decay[0, k - 1] * slow
        decay[1, k] = decay[1, k - 1] * fast
    energy = np.sum(rows[0] * rows[0])
    return Simulated(table, rows.shape[0], close, decay, integrating, modes, energy)


@kernel
def _rows(basis: Basis, slow: float, fast: float, integrating: bool) -> Array:
    """PV's unexplained part above the orthonormal shared columns."""
    shared = basis.slope if integrating else basis.level
    n, count = basis.target.size, shared.shape[0]
    pole = fast if integrating else slow
    rows = np.zeros((count + 1 + (1 if pole > 0.3 else 0), n))
    rows[0] = basis.target
    rows[1 : count + 1] = shared
    if pole > 0.3:
        # what is left of the state before the window decays with the slow pole
        start = rows[count + 1]
        power = 1.0
        raw = np.empty(n)
        for k in range(n):
            raw[k] = power
            power *= pole
        for k in range(n):
            total = 0.0
            for i in range(basis.taps.size):
                total += basis.taps[i] * raw[max(k - i, 0)]
            start[k] = total * basis.weight[k]
        before = np.sum(start * start)
        for _ in range(2):
            for r in range(1, count + 1):
                start -= np.sum(start * rows[r]) * rows[r]
        size = np.sum(start * start)
        if size > 1e-12 * before and size > 0.0:
            start /= np.sqrt(size)
        else:
            start[:] = 0.0
    for r in range(1, rows.shape[0]):
        rows[0] -= np.sum(rows[0] * rows[r]) * rows[r]
    return rows


@kernel
def _step_response(
    taps: Array, slow: float, fast: float, integrating: bool, n: int
) -> tuple[Array, Array]:
    """Coefficients of the modes (constant, slow, fast) and the response itself while it differs."""
    modes = np.zeros(3)
    if integrating:
        modes[0] = (1.0 - fast / (1.0 - fast)) / n
        modes[1] = 1.0 / n
        modes[2] = fast * fast / (1.0 - fast) / n
    else:
        modes[0] = 1.0
        if slow > 0.0:
            modes[1] = -(1.0 - fast) * slow * slow / (slow - fast)
        if fast > 0.0:
            modes[2] = (1.0 - slow) * fast * fast / (slow - fast)
    order = taps.size
    plain = np.empty(order)
    for m in range(order):
        ramp = float(m) if integrating else slow**m
        plain[m] = modes[0] + modes[1] * ramp + modes[2] * fast**m
    response = np.zeros(order)
    for m in range(order):
        for i in range(m + 1):
            response[m] += taps[i] * plain[m - i]
    filtered = np.zeros(3)
    for i in range(order):
        filtered[0] += taps[i] * (modes[0] - (modes[1] * i if integrating else 0.0))
        if integrating:
            filtered[1] += taps[i] * modes[1]
        elif slow > 0.0:
            filtered[1] += taps[i] * modes[1] * slow ** (-i)
        if fast > 0.0:
            filtered[2] += taps[i] * modes[2] * fast ** (-i)
    return filtered, response


@kernel
def _against_steps(
    rows: Array, taps: Array, slow: float, fast: float, integrating: bool, table: Array
) -> None:
    """For every sample, each row against the response to a step there (backward in time)."""
    n = rows.shape[1]
    for r in range(rows.shape[0]):
        one = two = total = 0.0
        for k in range(n - 1, -1, -1):
            value = 0.0
            for i in range(min(taps.size, n - k)):
                value += taps[i] * rows[r, k + i]
            one = one + value / n if integrating else slow * one + (1.0 - slow) * value
            two = fast * two + (1.0 - fast) * one
            total += two
            table[r, k] = total


@kernel
def _energies(
    weight: Array,
    modes: Array,
    response: Array,
    order: int,
    slow: float,
    fast: float,
    integrating: bool,
    table: Array,
    close: Array,
) -> None:
    """Energy of each mode, and of the step response, against the response to a step there."""
    n = weight.size
    rows = table.shape[0] - 4
    second, third = np.empty(order), np.empty(order)
    for m in range(order):
        second[m] = float(m) if integrating else slow**m
        third[m] = fast**m
    excess = response - modes[0] - modes[1] * second - modes[2] * third
    products = np.empty((order, order))
    for gap in range(order):
        for m in range(order - gap):
            products[gap, m] = excess[m + gap] * response[m]
    n00 = n01 = n02 = n11 = n12 = n22 = 0.0
    for k in range(n - 1, -1, -1):
        w = weight[k]
        if integrating:
            # the ramp is zero at the step itself and one later a sample on
            n11 = n11 + 2.0 * n01 + n00
            n12 = fast * (n12 + n02)
            n01 = n01 + n00
        else:
            n11 = w + slow * slow * n11
            n12 = w + slow * fast * n12
            n01 = w + slow * n01
        n00 = w + n00
        n02 = w + fast * n02
        n22 = w + fast * fast * n22
        e0 = modes[0] * n00 + modes[1] * n01 + modes[2] * n02
        e1 = modes[0] * n01 + modes[1] * n11 + modes[2] * n12
        e2 = modes[0] * n02 + modes[1] * n12 + modes[2] * n22
        for m in range(min(order, n - k)):
            part = weight[k + m] * excess[m]
            e0 += part
            e1 += part * second[m]
            e2 += part * third[m]
        own = modes[0] * e0 + modes[1] * e1 + modes[2] * e2
        for gap in range(order):
            total = 0.0
            for m in range(min(order - gap, n - k)):
                total += weight[k + m] * products[gap, m]
            close[gap, k] = total
        table[rows, k] = e0
        table[rows + 1, k] = e1
        table[rows + 2, k] = e2
        table[rows + 3, k] = own + close[0, k]


@kernel
def _simulated(
    tables: Simulated,
    at: Index,
    step: Array,
    count: int,
    lag: int,
    lags: int,
    sums: Array,
    cost: Array,
    gain: Array,
) -> None:
    """Costs and gains of the stem whose steps are given, for dead times from ``lag`` on."""
    rows = tables.rows
    order = tables.close.shape[0]
    sums[:] = 0.0
    z0 = z1 = z2 = 0.0
    before = 0
    squares = sums[rows]
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
        for r in range(rows):
            row = tables.table[r]
            total = sums[r]
            for d in range(lags):
                total[d] += c * row[t + d]
        constant, slow, fast = tables.table[rows], tables.table[rows + 1], tables.table[rows + 2]
        own = tables.table[rows + 3]
        two0, two1, two2, once = 2.0 * c * z0, 2.0 * c * z1, 2.0 * c * z2, c * c
        for d in range(lags):
            squares[d] += (
                two0 * constant[t + d] + two1 * slow[t + d] + two2 * fast[t + d] + once * own[t + d]
            )
        if order > 1:
            j = i - 1
            while j >= 0 and at[i] - at[j] < order:
                near = tables.close[at[i] - at[j]]
                both = 2.0 * c * step[j]
                for d in range(lags):
                    squares[d] += both * near[t + d]
                j -= 1
        z0 += c * tables.modes[0]
        z1 += c * tables.modes[1]
        z2 += c * tables.modes[2]
    for d in range(lags):
        left = squares[d]
        for r in range(1, rows):
            left -= sums[r, d] * sums[r, d]
        if left > _FLAT * squares[d] + 1e-12:
            gain[d] = sums[0, d] / left
        else:
            gain[d] = 0.0
        saved = gain[d] * sums[0, d]
        cost[d] = max(tables.energy - saved, 1e-12 * tables.energy + 1e-300)


@kernel
def simulated_costs(
    op: Op, tables: Simulated, nodes: Array, first: float, lag: int, lags: int
) -> tuple[Array, Array]:
    """Costs and gains, ``(lags, m)``, of the valves ``nodes``, ``(m, 3)``: S, J and lead."""
    m = nodes.shape[0]
    at, step = np.empty(op.u.size, np.int64), np.empty(op.u.size)
    sums = np.empty((tables.rows + 1, lags))
    cost, gain = np.full((lags, m), np.inf), np.zeros((lags, m))
    one, slope = np.empty(lags), np.empty(lags)
    for j in range(m):
        count = slips_into(op, nodes[j, 0], nodes[j, 1], nodes[j, 2], first, at, step)
        if count >= 2:
            _simulated(tables, at, step, count, lag, lags, sums, one, slope)
            cost[:, j] = one
            gain[:, j] = slope
    return cost, gain


@kernel
def simulated_steps(
    tables: Simulated, at: Index, step: Array, lag: int, lags: int
) -> tuple[Array, Array]:
    """Costs and gains, ``(lags,)``, of the stem that changes by ``step`` at the samples ``at``."""
    cost, gain = np.empty(lags), np.empty(lags)
    sums = np.empty((tables.rows + 1, lags))
    _simulated(tables, at, step, at.size, lag, lags, sums, cost, gain)
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
    sums = np.empty((tables[0].rows + 1, lags))
    one, slope = np.empty(lags), np.empty(lags)
    out = np.full((len(tables), lags, m), np.inf)
    for j in range(m):
        band, jump, lead, first = valves[j]
        count = slips_into(op, band, jump, lead, first, at, step)
        if count < 2 or count > most:
            continue
        for i in range(len(tables)):
            if sums.shape[0] != tables[i].rows + 1:
                sums = np.empty((tables[i].rows + 1, lags))
            _simulated(tables[i], at, step, count, 0, lags, sums, one, slope)
            out[i, :, j] = one
    return out


@kernel
def _box(
    op: Op, tables: Simulated, best: Array, half: Array, counts: Index, lag: int, lags: int
) -> bool:
    """The best valve and dead time of a box around ``best``, put into it; whether there is one."""
    at, step = np.empty(op.u.size, np.int64), np.empty(op.u.size)
    sums = np.empty((tables.rows + 1, lags))
    one, slope = np.empty(lags), np.empty(lags)
    band0, jump0, lead0 = best[1], best[2], best[3]
    found = False
    for a in range(counts[0]):
        band = band0 + half[0] * offset_of(a, counts[0])
        for b in range(counts[1]):
            jump = min(max(jump0 + half[1] * offset_of(b, counts[1]), 0.0), band)
            for c in range(counts[2]):
                lead = lead0 + half[2] * offset_of(c, counts[2])
                count = slips_into(op, band, jump, lead, best[4], at, step)
                if band <= 0.0 or count < 2:
                    continue
                _simulated(tables, at, step, count, lag, lags, sums, one, slope)
                for d in range(lags):
                    if one[d] < best[0]:
                        found = True
                        best[0], best[1], best[2], best[3] = one[d], band, jump, lead
                        best[5] = lag + d
    return found


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


_NEIGHBOURS = 10


@kernel
def refine_simulated(
    op: Op, basis: Basis, best: Array, half: Array, counts: Index, search: Search
) -> None:
    """Zoom in on valve, dead time and poles from ``best``, and put what is found into it.

    ``best`` holds cost, S, J, lead, direction of the first slip, dead time, slow and fast pole;
    ``half`` the half-widths in S, J, lead and in the logarithm of the time constants, narrowed in
    place by each pass.
    """
    around = np.array([counts[0], 1, 1])
    reach = search.reach
    for _ in range(search.passes):
        lag = max(search.shortest, int(best[5]) - reach)
        lags = min(search.longest, int(best[5]) + reach) - lag + 1
        pad = search.longest + 1
        tables = simulated_tables(basis, best[6], best[7], pad)
        _box(op, tables, best, half, counts, lag, lags)
        slow, fast = best[6], best[7]
        for i in range(_NEIGHBOURS):
            a, b = _neighbour(i, slow, fast, np.exp(half[3]))
            if a == slow and b == fast:
                continue
            near = simulated_tables(basis, a, b, pad)
            lag = max(search.shortest, int(best[5]) - reach)
            lags = min(search.longest, int(best[5]) + reach) - lag + 1
            if _box(op, near, best, half, around, lag, lags):
                best[6], best[7] = a, b
        for axis in range(4):
            half[axis] *= search.shrink[axis]
        reach = min(reach, 1)


@kernel
def refine_process(
    basis: Basis, at: Index, step: Array, best: Array, width: float, search: Search
) -> None:
    """Zoom in on dead time and poles for a known stem; ``best`` as in :func:`refine_simulated`."""
    sums = np.empty((basis.slope.shape[0] + 3, search.longest + 1))
    one, slope = np.empty(search.longest + 1), np.empty(search.longest + 1)
    for _ in range(search.passes):
        slow, fast = best[6], best[7]
        for i in range(_NEIGHBOURS):
            a, b = _neighbour(i, slow, fast, np.exp(width))
            if a == slow and b == fast and i != 4:
                continue
            tables = simulated_tables(basis, a, b, search.longest + 1)
            lag = max(search.shortest, int(best[5]) - search.reach)
            lags = min(search.longest, int(best[5]) + search.reach) - lag + 1
            _simulated(
                tables, at, step, at.size, lag, lags, sums[: tables.rows + 1, :lags], one, slope
            )
            for d in range(lags):
                if one[d] < best[0]:
                    best[0], best[5], best[6], best[7] = one[d], lag + d, a, b
        width *= search.shrink[3]
