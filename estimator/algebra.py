"""Compiled linear algebra on the rows of one window: products, bases, least squares.

Sums are taken in an order that the source fixes: they are the same bits on every processor.
"""

from __future__ import annotations

import math

import numpy as np

from compiled import innermost, kernel
from estimator.arrays import Array, Index

__all__ = [
    "cholesky",
    "combine",
    "dot",
    "filter_rows",
    "is_stable",
    "local_equations",
    "normal_equations",
    "order_of",
    "orthonormal",
    "project_out",
    "solve_spd",
    "stepped",
]

_AT_ONCE = 4
"""Taps that one pass adds to a sum, one after the other: the same bits as one a pass."""
_SIDE_BY_SIDE = 32
"""Sums of one product that are kept side by side: enough that none waits for the one before."""
_SPANNED = 1e-9
"""A column of which less than this share (squared) is left is spanned by the others."""

_NOTHING = 1e-10
"""Share of a row's largest number below which the numbers at its ends are taken for zero."""
_ALIKE = 1e-10
"""Costs that differ by less, as a share of the least, are alike: rounding decides nothing."""


@kernel
def order_of(costs: Array) -> Index:
    """Numbers of the costs ``(m,)`` in rising order; those that are alike in the order given."""
    return np.argsort(stepped(costs), kind="mergesort")


@kernel
def stepped(costs: Array) -> Array:
    """The costs in steps within which they are alike; none where the least cost is zero."""
    steps = costs.copy()
    unit = 0.0
    if costs.size > 0:
        unit = _ALIKE * np.abs(costs).min()
    if 0.0 < unit < np.inf:
        for i in range(costs.size):
            steps[i] = np.floor(costs[i] / unit + 0.5)
    return steps


@kernel
def dot(a: Array, b: Array) -> float:
    """Sum of products, in many sums side by side: the same bits on every processor."""
    return dot_in(np.empty(_SIDE_BY_SIDE), a, b)


@kernel
def dot_in(sums: Array, a: Array, b: Array) -> float:
    """The same with room ``(32,)`` for its sums: asking for that at every product costs more."""
    n, side = a.size, sums.size
    sums[:] = 0.0
    k = 0
    while k + 4 * side <= n:
        a0, a1, a2, a3 = a[k : k + side], a[k + side :], a[k + 2 * side :], a[k + 3 * side :]
        b0, b1, b2, b3 = b[k : k + side], b[k + side :], b[k + 2 * side :], b[k + 3 * side :]
        _add_products(sums, a0, a1, a2, a3, b0, b1, b2, b3)
        k += 4 * side
    t0 = t1 = t2 = t3 = 0.0
    while k + 4 <= n:
        t0 += a[k] * b[k]
        t1 += a[k + 1] * b[k + 1]
        t2 += a[k + 2] * b[k + 2]
        t3 += a[k + 3] * b[k + 3]
        k += 4
    while k < n:
        t0 += a[k] * b[k]
        k += 1
    for i in range(0, side, 4):
        t0 += sums[i]
        t1 += sums[i + 1]
        t2 += sums[i + 2]
        t3 += sums[i + 3]
    return (t0 + t1) + (t2 + t3)


@innermost
def _add_products(
    sums: Array,
    a0: Array,
    a1: Array,
    a2: Array,
    a3: Array,
    b0: Array,
    b1: Array,
    b2: Array,
    b3: Array,
) -> None:
    """Add the products of four runs of numbers to sums side by side."""
    for i in range(sums.size):
        sums[i] = sums[i] + a0[i] * b0[i] + a1[i] * b1[i] + a2[i] * b2[i] + a3[i] * b3[i]


@kernel
def filter_rows(rows: Array, taps: Array, weight: Array) -> Array:
    """Rows ``(m, n)`` through ``1 - taps_1 q^-1 - ...``, times ``weight`` ``(n,)``."""
    m, n = rows.shape
    out = rows.copy()
    count = min(taps.size, n)
    for r in range(m):
        now, row = out[r, count:], rows[r]
        for k in range(1, count):
            for i in range(k):
                out[r, k] -= taps[i] * row[k - 1 - i]
        i = 0
        while i + _AT_ONCE <= count:
            t0, t1, t2, t3 = taps[i], taps[i + 1], taps[i + 2], taps[i + 3]
            s0, s1 = row[count - 1 - i :], row[count - 2 - i :]
            s2, s3 = row[count - 3 - i :], row[count - 4 - i :]
            for k in range(now.size):
                now[k] = now[k] - t0 * s0[k] - t1 * s1[k] - t2 * s2[k] - t3 * s3[k]
            i += _AT_ONCE
        while i < count:
            tap, before = taps[i], row[count - 1 - i :]
            for k in range(now.size):
                now[k] -= tap * before[k]
            i += 1
        for k in range(n):
            out[r, k] = out[r, k] * weight[k] if weight[k] != 0.0 else 0.0
    return out


@kernel
def is_stable(taps: Array, largest: float) -> bool:
    """Whether no reflection coefficient of ``1 - taps_1 q^-1 - ...`` is beyond ``largest``.

    With a largest one below 1 all roots are inside the unit circle, by Schur and Cohn (Jury 1964,
    "Theory and application of the z-transform method", chapter 3).
    """
    now = taps.copy()
    for m in range(taps.size, 0, -1):
        last = now[m - 1]
        if not abs(last) <= largest:
            return False
        below = np.empty(m - 1)
        for i in range(m - 1):
            below[i] = (now[i] + last * now[m - 2 - i]) / (1.0 - last * last)
        now = below
    return True


@kernel
def orthonormal(rows: Array, spanned: float = _SPANNED) -> Array:
    """Orthonormal rows of the same span, in order; what others span is left out (Gram-Schmidt).

    That is a row of whose sum of squares no more than a share ``spanned`` is left by the others.
    """
    m, n = rows.shape
    basis, room = np.empty((m, n)), np.empty(_SIDE_BY_SIDE)
    count = 0
    for r in range(m):
        v = rows[r].copy()
        whole = dot_in(room, v, v)
        if not whole > 0.0:
            continue
        for _ in range(2):
            for c in range(count):
                share = dot_in(room, basis[c], v)
                for k in range(n):
                    v[k] -= share * basis[c, k]
        left = dot_in(room, v, v)
        if left > spanned * whole:
            scale = 1.0 / math.sqrt(left)
            for k in range(n):
                basis[count, k] = v[k] * scale
            count += 1
    return basis[:count].copy()


@kernel
def project_out(signal: Array, basis: Array) -> Array:
    """What orthonormal rows ``(m, n)`` leave of a signal ``(n,)``."""
    left, room = signal.copy(), np.empty(_SIDE_BY_SIDE)
    for c in range(basis.shape[0]):
        share = dot_in(room, basis[c], left)
        for k in range(left.size):
            left[k] -= share * basis[c, k]
    return left


@kernel
def cholesky(matrix: Array) -> Array:
    """Lower factor of a symmetric positive (semi-)definite matrix; zero where it has no extent."""
    n = matrix.shape[0]
    root = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            if i == j:
                root[i, i] = math.sqrt(max(total, 0.0))
            elif root[j, j] > 0.0:
                root[i, j] = total / root[j, j]
    return root


@kernel
def solve_spd(matrix: Array, right: Array) -> Array:
    """Solve a symmetric positive (semi-)definite system by Cholesky; spanned unknowns are zero."""
    n = right.size
    root = np.zeros((n, n))
    used = np.zeros(n)
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            if i == j:
                if total > 1e-12 * matrix[i, i]:
                    root[i, i] = math.sqrt(total)
                    used[i] = 1.0
            elif used[j] > 0.0:
                root[i, j] = total / root[j, j]
    x = np.zeros(n)
    for i in range(n):
        if used[i] > 0.0:
            total = right[i]
            for k in range(i):
                total -= root[i, k] * x[k]
            x[i] = total / root[i, i]
    for i in range(n - 1, -1, -1):
        if used[i] > 0.0:
            total = x[i]
            for k in range(i + 1, n):
                total -= root[k, i] * x[k]
            x[i] = total / root[i, i]
        else:
            x[i] = 0.0
    return x


@kernel
def normal_equations(design: Array, target: Array) -> tuple[Array, Array]:
    """Products of the rows ``(m, n)`` with each other and with the target ``(n,)``."""
    m = design.shape[0]
    gram, right, room = np.empty((m, m)), np.empty(m), np.empty(_SIDE_BY_SIDE)
    for i in range(m):
        right[i] = dot_in(room, design[i], target)
        for j in range(i + 1):
            gram[i, j] = dot_in(room, design[i], design[j])
            gram[j, i] = gram[i, j]
    return gram, right


@kernel
def local_equations(rows: Array, basis: Array, target: Array) -> tuple[Array, Array]:
    """Products with each other and with a target of what a basis leaves of rows.

    Args:
        rows: ``(m, n)``; at their ends, numbers below 1e-10 of a row's largest count as zero.
        basis: orthonormal rows, ``(k, n)``.
        target: what the basis leaves of a signal, ``(n,)``.

    Returns:
        Products ``(m, m)`` of what is left of the rows, and ``(m,)`` of that with the target.
    """
    m, k = rows.shape[0], basis.shape[0]
    room = np.empty(_SIDE_BY_SIDE)
    begins, ends = _stretches(rows)
    gram, right, shares = np.empty((m, m)), np.empty(m), np.empty((m, k))
    for i in range(m):
        row = rows[i, begins[i] : ends[i]]
        right[i] = dot_in(room, row, target[begins[i] : ends[i]])
        for c in range(k):
            shares[i, c] = dot_in(room, row, basis[c, begins[i] : ends[i]])
        for j in range(i + 1):
            total, begin, end = 0.0, max(begins[i], begins[j]), min(ends[i], ends[j])
            if begin < end:
                total = dot_in(room, rows[i, begin:end], rows[j, begin:end])
            for c in range(k):
                total -= shares[i, c] * shares[j, c]
            gram[i, j] = gram[j, i] = total
    return gram, right


@kernel
def _stretches(rows: Array) -> tuple[Index, Index]:
    """Where each of the rows ``(m, n)`` begins to be more than nothing, and where it ends."""
    m, n = rows.shape
    begins, ends = np.zeros(m, np.int64), np.zeros(m, np.int64)
    for i in range(m):
        least = _NOTHING * np.abs(rows[i]).max()
        begin, end = 0, n
        while begin < end and abs(rows[i, begin]) <= least:
            begin += 1
        while begin < end and abs(rows[i, end - 1]) <= least:
            end -= 1
        begins[i], ends[i] = begin, end
    return begins, ends


@kernel
def combine(shares: Array, signals: Array) -> Array:
    """Sum of signals ``(m, n)``, each times its share ``(m,)``."""
    total = np.zeros(signals.shape[1])
    for i in range(shares.size):
        for k in range(total.size):
            total[k] += shares[i] * signals[i, k]
    return total
