"""Compiled loops that work on many candidates side by side, one a lane.

Signals of a batch have shape ``(n, L)``: samples down, candidates across. The innermost loop goes
over the lanes, which are independent of each other, so that the result of a candidate is the same
bits whatever the width of the processor's lanes and whichever other candidates stand beside it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from compiled import kernel

__all__ = [
    "Array",
    "Index",
    "Mask",
    "cholesky",
    "count_moves",
    "delayed_costs",
    "dot",
    "filter_rows",
    "orthonormal",
    "paired_costs",
    "project_out",
    "respond",
    "respond_one",
    "solve_spd",
    "whiten_lanes",
]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_SPANNED = 1e-9
"""A column of which less than this share (squared) is left is spanned by the others."""


@kernel
def dot(a: Array, b: Array) -> float:
    """Sum of products in the order of the samples: the same bits on every processor."""
    total = 0.0
    for k in range(a.size):
        total += a[k] * b[k]
    return total


@kernel
def respond(stems: Array, c1: Array, c2: Array, third: Array, gain: Array) -> Array:
    """Responses ``(n, L)`` of two poles (``c1``, ``c2``), a lag (``third``) and a ``gain`` a lane.

    ``v_k = c1 v_(k-1) + c2 v_(k-2) + gain (x_k - x_0)``, then the lag; at rest before the window.
    """
    n, lanes = stems.shape
    out = np.empty((n, lanes))
    v1, v2, w = np.zeros(lanes), np.zeros(lanes), np.zeros(lanes)
    for k in range(n):
        for j in range(lanes):
            v = c1[j] * v1[j] + c2[j] * v2[j] + gain[j] * (stems[k, j] - stems[0, j])
            v2[j] = v1[j]
            v1[j] = v
            w[j] = third[j] * w[j] + (1.0 - third[j]) * v
            out[k, j] = w[j]
    return out


@kernel
def respond_one(stem: Array, c1: float, c2: float, third: float, gain: float) -> Array:
    """The same for one stem ``(n,)``."""
    out = np.empty(stem.size)
    v1 = v2 = w = 0.0
    for k in range(stem.size):
        v = c1 * v1 + c2 * v2 + gain * (stem[k] - stem[0])
        v2 = v1
        v1 = v
        w = third * w + (1.0 - third) * v
        out[k] = w
    return out


@kernel
def whiten_lanes(signals: Array, taps: Array) -> None:
    """Apply ``1 - taps_1 q^-1 - ...`` to signals ``(n, L)`` in place; the first rows stay."""
    n, lanes = signals.shape
    for k in range(n - 1, taps.size - 1, -1):
        for i in range(taps.size):
            tap = taps[i]
            for j in range(lanes):
                signals[k, j] -= tap * signals[k - 1 - i, j]


@kernel
def filter_rows(rows: Array, taps: Array, weight: Array) -> Array:
    """Rows ``(m, n)`` through ``1 - taps_1 q^-1 - ...``, times ``weight`` ``(n,)``."""
    m, n = rows.shape
    out = np.zeros((m, n))
    for r in range(m):
        for k in range(n):
            if weight[k] != 0.0:
                total = rows[r, k]
                for i in range(min(taps.size, k)):
                    total -= taps[i] * rows[r, k - 1 - i]
                out[r, k] = total * weight[k]
    return out


@kernel
def orthonormal(rows: Array) -> Array:
    """Orthonormal rows of the same span, in order; what others span is left out (Gram-Schmidt)."""
    m, n = rows.shape
    basis = np.empty((m, n))
    count = 0
    for r in range(m):
        v = rows[r].copy()
        whole = dot(v, v)
        if not whole > 0.0:
            continue
        for _ in range(2):
            for c in range(count):
                share = dot(basis[c], v)
                for k in range(n):
                    v[k] -= share * basis[c, k]
        left = dot(v, v)
        if left > _SPANNED * whole:
            scale = 1.0 / math.sqrt(left)
            for k in range(n):
                basis[count, k] = v[k] * scale
            count += 1
    return basis[:count].copy()


@kernel
def project_out(signal: Array, basis: Array) -> Array:
    """What orthonormal rows ``(m, n)`` leave of a signal ``(n,)``."""
    left = signal.copy()
    for c in range(basis.shape[0]):
        share = dot(basis[c], left)
        for k in range(left.size):
            left[k] -= share * basis[c, k]
    return left


@kernel
def count_moves(stems: Array) -> Index:
    """Samples in which each stem of ``(n, L)`` moves, ``(L,)``."""
    n, lanes = stems.shape
    found = np.zeros(lanes, dtype=np.int64)
    for k in range(1, n):
        for j in range(lanes):
            found[j] += stems[k, j] != stems[k - 1, j]
    return found


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
def _sums(
    responses: Array, weight: Array, target: Array, basis: Array, first: int, late: int, paired: int
) -> tuple[Array, Array, Array]:
    """Energy, covariance with the target, and cross-energy with the next dead time, each ``(L,)``.

    All after the ``basis`` is taken out; a lane that the basis spans has energy 0.
    """
    n, lanes = responses.shape
    columns = basis.shape[0]
    energy, raw, with_y, cross = (
        np.zeros(lanes),
        np.zeros(lanes),
        np.zeros(lanes),
        np.zeros(lanes),
    )
    share, share_next = np.zeros((columns, lanes)), np.zeros((columns, lanes))
    for k in range(first, n):
        w, y = weight[k], target[k]
        if w == 0.0:
            continue
        row = k - late
        if paired == 1:
            for j in range(lanes):
                z = responses[row, j]
                raw[j] += z * z
                with_y[j] += z * y
                cross[j] += z * responses[row - 1, j]
        else:
            for j in range(lanes):
                z = responses[row, j]
                raw[j] += z * z
                with_y[j] += z * y
        for c in range(columns):
            q = basis[c, k]
            for j in range(lanes):
                share[c, j] += q * responses[row, j]
            if paired == 1:
                for j in range(lanes):
                    share_next[c, j] += q * responses[row - 1, j]
    for j in range(lanes):
        energy[j] = raw[j]
    for c in range(columns):
        for j in range(lanes):
            energy[j] -= share[c, j] * share[c, j]
            cross[j] -= share[c, j] * share_next[c, j]
    for j in range(lanes):
        if not energy[j] > 1e-7 * raw[j]:
            energy[j] = 0.0
    return energy, with_y, cross


@kernel
def delayed_costs(
    responses: Array,
    weight: Array,
    target: Array,
    basis: Array,
    rest: float,
    first: int,
    delays: Index,
    sign: float,
) -> Array:
    """Least sum of squares ``(D, L)`` of the target on whitened responses, one gain each.

    ``rest`` is the target's own sum of squares; a gain of the wrong ``sign`` counts as none.
    """
    lanes = responses.shape[1]
    out = np.empty((delays.size, lanes))
    for d in range(delays.size):
        energy, with_y, _ = _sums(responses, weight, target, basis, first, delays[d], 0)
        for j in range(lanes):
            out[d, j] = rest
            if energy[j] > 0.0 and sign * with_y[j] >= 0.0:
                out[d, j] = rest - with_y[j] * with_y[j] / energy[j]
    return out


@kernel
def paired_costs(
    responses: Array,
    weight: Array,
    target: Array,
    basis: Array,
    rest: float,
    first: int,
    shortest: int,
    count: int,
    sign: float,
) -> Array:
    """Least sum of squares ``(count, L)`` on the responses of two dead times that follow each other.

    The two gains have one sign (that of the loop where ``sign`` is not 0): together they are a dead
    time between two samples.
    """
    lanes = responses.shape[1]
    out = np.empty((count, lanes))
    energy = np.zeros((count + 1, lanes))
    with_y = np.zeros((count + 1, lanes))
    cross = np.zeros((count + 1, lanes))
    for d in range(count + 1):
        paired = 1 if d < count else 0
        e, a, c = _sums(responses, weight, target, basis, first, shortest + d, paired)
        energy[d], with_y[d], cross[d] = e, a, c
    for d in range(count):
        for j in range(lanes):
            e1, e2, a1, a2, c = (
                energy[d, j],
                energy[d + 1, j],
                with_y[d, j],
                with_y[d + 1, j],
                cross[d, j],
            )
            gain = 0.0
            if e1 > 0.0 and sign * a1 >= 0.0:
                gain = a1 * a1 / e1
            if e2 > 0.0 and sign * a2 >= 0.0:
                gain = max(gain, a2 * a2 / e2)
            det = e1 * e2 - c * c
            if det > 1e-9 * e1 * e2 and e1 > 0.0:
                g1, g2 = (a1 * e2 - a2 * c) / det, (a2 * e1 - a1 * c) / det
                if g1 * g2 >= 0.0 and sign * g1 >= 0.0 and sign * g2 >= 0.0:
                    gain = max(gain, g1 * a1 + g2 * a2)
            out[d, j] = rest - gain
    return out
