"""Compiled sums of the one-step criterion: least squares on PV's past and the stem's, per valve.

The regressors of the stem are taken as ``x_(k-d)`` and the steps ``x_(k-d) - x_(k-d-1)``, and
``x_(k-d-1) - x_(k-d-2)``: they span what the ``b`` of equation (8) multiply, steps are zero except
after a slip, and the first coefficient is the sum of the ``b``. A constant added to the stem is the
intercept's, so that the stem is counted from where it stood at first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator._kernels import Array, Index, kernel
from estimator._slips import Op, slips_into, valves_around

__all__ = [
    "OneStep",
    "cost_of_slips",
    "one_step_costs",
    "recursion",
    "refine_one_step",
    "residual_sums",
]

_FLAT = 1e-5
_RIDGE = 1e-9


class OneStep(NamedTuple):
    """Tables of one ARX structure, read at the samples of the slips.

    ``table`` has shape ``(n + pad, width)``; of its columns the first ``rows`` are PV's unexplained
    part and its orthonormal past, summed from the sample on, then the same rows themselves at the
    dead time, and one sample later; then the weights, likewise. ``energy`` is that of PV's
    unexplained part; ``through`` what turns shared parts into the sum of the ``a``.
    """

    table: Array
    rows: int
    nb: int
    energy: float
    through: Array


@kernel
def cost_of_slips(
    tables: OneStep, at: Index, step: Array, count: int, sums: Array
) -> tuple[float, float]:
    """Cost and steady-state gain of the valve whose slips are given."""
    rows, nb = tables.rows, tables.nb
    used = max(nb, 2) * rows
    sums[: 3 * rows] = 0.0
    g11 = g12 = g13 = g22 = g23 = g33 = 0.0
    x = 0.0
    for i in range(count):
        c = step[i]
        now = x + c
        row = tables.table[at[i]]
        for r in range(used):
            sums[r] += c * row[r]
        w, later = row[3 * rows + 1], row[3 * rows + 2]
        g11 += (now * now - x * x) * row[3 * rows]
        g12 += c * now * w
        g22 += c * c * w
        g33 += c * c * later
        after = now
        if i + 1 < count and at[i + 1] == at[i] + 1:
            after = now + step[i + 1]
            g23 += c * step[i + 1] * later
        g13 += c * after * later
        x = now
    r1, r2, r3 = sums[0], sums[rows], sums[2 * rows]
    plain = g11
    for r in range(1, rows):
        p1, p2, p3 = sums[r], sums[rows + r], sums[2 * rows + r]
        g11 -= p1 * p1
        g12 -= p1 * p2
        g13 -= p1 * p3
        g22 -= p2 * p2
        g23 -= p2 * p3
        g33 -= p3 * p3
    c1 = c2 = c3 = 0.0
    if g11 > _FLAT * plain:
        g11 *= 1.0 + _RIDGE
        g22 = g22 * (1.0 + _RIDGE) + 1e-12
        g33 = g33 * (1.0 + _RIDGE) + 1e-12
        l21 = g12 / g11
        e22 = max(g22 - l21 * g12, _RIDGE * g22)
        f2 = r2 - l21 * r1
        if nb == 3:
            l31 = g13 / g11
            e23 = g23 - l31 * g12
            l32 = e23 / e22
            e33 = max(g33 - l31 * g13 - l32 * e23, _RIDGE * g33)
            c3 = (r3 - l31 * r1 - l32 * f2) / e33
            c2 = (f2 - e23 * c3) / e22
        elif nb == 2:
            c2 = f2 / e22
        c1 = (r1 - g12 * c2 - g13 * c3) / g11
    explained = c1 * r1 + c2 * r2 + c3 * r3
    rest = tables.through[0]
    for r in range(1, rows):
        shared = c1 * sums[r] + c2 * sums[rows + r] + c3 * sums[2 * rows + r]
        rest += tables.through[r] * shared
    cost = max(tables.energy - explained, 1e-12 * tables.energy + 1e-300)
    return cost, c1 / rest


@kernel
def one_step_costs(op: Op, tables: OneStep, nodes: Array, first: float) -> tuple[Array, Array]:
    """Costs and gains of the valves ``nodes``, ``(m, 3)``: S, J and lead; infinite where none."""
    at, step = np.empty(op.u.size, np.int64), np.empty(op.u.size)
    sums = np.empty(3 * tables.rows)
    cost, gain = np.full(nodes.shape[0], np.inf), np.zeros(nodes.shape[0])
    for j in range(nodes.shape[0]):
        count = slips_into(op, nodes[j, 0], nodes[j, 1], nodes[j, 2], first, at, step)
        if count >= 2:
            cost[j], gain[j] = cost_of_slips(tables, at, step, count, sums)
    return cost, gain


@kernel
def refine_one_step(
    op: Op, tables: OneStep, best: Array, half: Array, boxes: Index, passes: int, shrink: Array
) -> None:
    """Zoom in on the valve from ``best`` (cost, S, J, lead, first direction), put into it.

    ``half`` holds the half-widths of the box in S, J and lead, narrowed in place by each pass,
    which looks at the valves of ``boxes`` (`valves_around`), ``(k, 3)``, one after the other.
    """
    at, step = np.empty(op.u.size, np.int64), np.empty(op.u.size)
    sums = np.empty(3 * tables.rows)
    for _ in range(passes):
        for counts in boxes:
            for band, jump, lead in valves_around(best[1:4].copy(), half, counts):
                count = slips_into(op, band, jump, lead, best[4], at, step)
                if band <= 0.0 or count < 2:
                    continue
                cost, _ = cost_of_slips(tables, at, step, count, sums)
                if cost < best[0]:
                    best[0], best[1], best[2], best[3] = cost, band, jump, lead
        for axis in range(3):
            half[axis] *= shrink[axis]


@kernel
def residual_sums(gram: Array, most_na: int, most_nb: int, longest: int) -> Array:
    """Residual sums of squares of ARX(na, nb) with each dead time, ``(na, nb, dead time)``.

    ``gram`` is that of the columns 1, ``y_(k-1)`` to ``y_(k-na)``, the stem by delays from 1 on,
    and ``y_k``. Columns are eliminated one after the other (Cholesky), the stem's last.
    """
    out = np.empty((most_na, most_nb, longest))
    last = gram.shape[0] - 1
    floor = 1e-12 * gram[last, last] + 1e-300
    index = np.empty(most_na + most_nb + 1, np.int64)
    root = np.empty((most_na + most_nb + 2, most_na + most_nb + 2))
    for na in range(1, most_na + 1):
        for d in range(1, longest + 1):
            for i in range(na + 1):
                index[i] = i
            for i in range(most_nb):
                index[na + 1 + i] = most_na + d + i
            left = gram[last, last]
            for i in range(na + 1 + most_nb):
                own = gram[index[i], index[i]]
                pivot = own * (1.0 + 1e-10) + 1e-12
                for j in range(i):
                    total = gram[index[i], index[j]]
                    for k in range(j):
                        total -= root[i, k] * root[j, k]
                    root[i, j] = total / root[j, j]
                    pivot -= root[i, j] * root[i, j]
                root[i, i] = np.sqrt(max(pivot, 1e-12 * own + 1e-300))
                right = gram[index[i], last]
                for k in range(i):
                    right -= root[i, k] * root[most_na + most_nb + 1, k]
                right /= root[i, i]
                root[most_na + most_nb + 1, i] = right
                left -= right * right
                if i > na:
                    out[na - 1, i - na - 1, d - 1] = max(left, floor)
    return out


@kernel
def recursion(a: Array, drive: Array, start: Array) -> Array:
    """``y_k = drive_k - a_1 y_(k-1) - ...``, shape ``(n,)``, from ``start``, shape ``(na,)``."""
    na = a.size
    y = np.empty(na + drive.size)
    y[:na] = start
    for k in range(drive.size):
        total = drive[k]
        for i in range(na):
            total -= a[i] * y[na + k - 1 - i]
        y[na + k] = total
    return y[na:]
