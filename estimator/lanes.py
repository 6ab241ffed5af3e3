"""Compiled loops that work on many candidates side by side, one a lane.

Signals of a batch have shape ``(n, L)``: samples down, candidates across. The innermost loop goes
over the lanes, which are independent of each other, so that the result of a candidate is the same
bits whatever the width of the processor's lanes and whichever other candidates stand beside it.
"""

from __future__ import annotations

import numpy as np

from compiled import kernel
from estimator.arrays import Array, Index

__all__ = [
    "delayed_costs",
    "paired_costs",
    "respond",
    "respond_one",
    "tells",
    "whiten_lanes",
]

_AT_ONCE = 4
"""Terms that one pass adds to a sum, one after the other: the same bits as one a pass, and a
quarter of the reading and writing."""


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
    count = taps.size
    for k in range(n - 1, count - 1, -1):
        now = signals[k]
        i = 0
        while i + _AT_ONCE <= count:
            t0, t1, t2, t3 = taps[i], taps[i + 1], taps[i + 2], taps[i + 3]
            s0, s1 = signals[k - 1 - i], signals[k - 2 - i]
            s2, s3 = signals[k - 3 - i], signals[k - 4 - i]
            for j in range(lanes):
                now[j] = now[j] - t0 * s0[j] - t1 * s1[j] - t2 * s2[j] - t3 * s3[j]
            i += _AT_ONCE
        while i < count:
            tap, before = taps[i], signals[k - 1 - i]
            for j in range(lanes):
                now[j] -= tap * before[j]
            i += 1


@kernel
def tells(stems: Array, op: Array, least_reversals: int, least_variance: float) -> Array:
    """1 for each stem of ``(n, L)`` that works like a valve, else 0; ``(L,)``.

    It turns often enough (what happens once is a step, which anything explains), and its variance
    is at least a share of OP's: (11b) of Bacci di Capaci et al., 2018.
    """
    n, lanes = stems.shape
    direction, turns = np.zeros(lanes), np.zeros(lanes)
    total, squares = np.zeros(lanes), np.zeros(lanes)
    for j in range(lanes):
        total[j] = stems[0, j]
        squares[j] = stems[0, j] * stems[0, j]
    for k in range(1, n):
        for j in range(lanes):
            x = stems[k, j]
            step = x - stems[k - 1, j]
            total[j] += x
            squares[j] += x * x
            now = 1.0 if step > 0.0 else (-1.0 if step < 0.0 else direction[j])
            turns[j] += 1.0 if now * direction[j] < 0.0 else 0.0
            direction[j] = now
    sum_op = squares_op = 0.0
    for k in range(n):
        sum_op += op[k]
        squares_op += op[k] * op[k]
    spread_op = squares_op - sum_op * sum_op / n
    out = np.zeros(lanes)
    for j in range(lanes):
        spread = squares[j] - total[j] * total[j] / n
        if turns[j] >= least_reversals and spread >= least_variance * spread_op:
            out[j] = 1.0
    return out


@kernel
def _sums(
    responses: Array,
    weight: Array,
    target: Array,
    basis: Array,
    first: int,
    late: int,
    stride: int,
    out: Array,
    share: Array,
) -> None:
    """Energy, covariance with the target and cross-energy with the next dead time: ``out (3, L)``.

    ``share`` ``(m, L)`` becomes the covariances with the ``basis``. Every ``stride``-th row counts.
    """
    n, lanes = responses.shape
    out[:] = 0.0
    share[:] = 0.0
    rows = np.empty(n, dtype=np.int64)
    count = 0
    for k in range(first, n, stride):
        if weight[k] != 0.0:
            rows[count] = k
            count += 1
    b = 0
    while b + _AT_ONCE <= count:
        k0, k1, k2, k3 = rows[b], rows[b + 1], rows[b + 2], rows[b + 3]
        y0, y1, y2, y3 = target[k0], target[k1], target[k2], target[k3]
        r0, r1 = responses[k0 - late], responses[k1 - late]
        r2, r3 = responses[k2 - late], responses[k3 - late]
        p0, p1 = responses[k0 - late - 1], responses[k1 - late - 1]
        p2, p3 = responses[k2 - late - 1], responses[k3 - late - 1]
        for j in range(lanes):
            z0, z1, z2, z3 = r0[j], r1[j], r2[j], r3[j]
            out[0, j] = out[0, j] + z0 * z0 + z1 * z1 + z2 * z2 + z3 * z3
            out[1, j] = out[1, j] + z0 * y0 + z1 * y1 + z2 * y2 + z3 * y3
            out[2, j] = out[2, j] + z0 * p0[j] + z1 * p1[j] + z2 * p2[j] + z3 * p3[j]
        for c in range(basis.shape[0]):
            q0, q1, q2, q3 = basis[c, k0], basis[c, k1], basis[c, k2], basis[c, k3]
            now = share[c]
            for j in range(lanes):
                now[j] = now[j] + q0 * r0[j] + q1 * r1[j] + q2 * r2[j] + q3 * r3[j]
        b += _AT_ONCE
    while b < count:
        k = rows[b]
        y, row = target[k], k - late
        for j in range(lanes):
            z = responses[row, j]
            out[0, j] += z * z
            out[1, j] += z * y
            out[2, j] += z * responses[row - 1, j]
        for c in range(basis.shape[0]):
            q = basis[c, k]
            for j in range(lanes):
                share[c, j] += q * responses[row, j]
        b += 1


@kernel
def delayed_costs(
    responses: Array,
    weight: Array,
    target: Array,
    basis: Array,
    rest: float,
    first: int,
    delays: Index,
    stride: int,
    sign: float,
) -> Array:
    """Least sum of squares ``(D, L)`` of the target on whitened responses, one gain each.

    ``rest`` is the target's own sum of squares; a gain of the wrong ``sign`` counts as none. With a
    ``stride`` above 1 the sums are those of every so many rows, scaled up: a ranking, not a cost.
    """
    lanes = responses.shape[1]
    out = np.empty((delays.size, lanes))
    sums, share = np.empty((3, lanes)), np.empty((basis.shape[0], lanes))
    for d in range(delays.size):
        _sums(responses, weight, target, basis, first, delays[d], stride, sums, share)
        for j in range(lanes):
            energy = sums[0, j] * stride
            for c in range(basis.shape[0]):
                energy -= share[c, j] * share[c, j] * stride * stride
            with_y = sums[1, j] * stride
            out[d, j] = rest
            if energy > 1e-7 * stride * sums[0, j] and sign * with_y >= 0.0:
                out[d, j] = rest - with_y * with_y / energy
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
    stride: int,
    sign: float,
) -> Array:
    """Least sum of squares ``(count, L)`` on the responses of two dead times in a row.

    The two gains have one sign (that of the loop where ``sign`` is not 0): together they are a dead
    time between two samples. With a ``stride`` above 1 it is a ranking, as in `delayed_costs`.
    """
    lanes = responses.shape[1]
    out = np.empty((count, lanes))
    sums = np.empty((count + 1, 3, lanes))
    share = np.empty((count + 1, basis.shape[0], lanes))
    for d in range(count + 1):
        _sums(responses, weight, target, basis, first, shortest + d, stride, sums[d], share[d])
        for j in range(lanes):
            energy = stride * sums[d, 0, j]
            sums[d, 1, j] *= stride
            sums[d, 2, j] *= stride
            for c in range(basis.shape[0]):
                share[d, c, j] *= stride
                energy -= share[d, c, j] * share[d, c, j]
            sums[d, 0, j] = energy if energy > 1e-7 * stride * sums[d, 0, j] else 0.0
    for d in range(count):
        for j in range(lanes):
            e1, e2 = sums[d, 0, j], sums[d + 1, 0, j]
            a1, a2 = sums[d, 1, j], sums[d + 1, 1, j]
            cross = sums[d, 2, j]
            for c in range(basis.shape[0]):
                cross -= share[d, c, j] * share[d + 1, c, j]
            gain = 0.0
            if e1 > 0.0 and sign * a1 >= 0.0:
                gain = a1 * a1 / e1
            if e2 > 0.0 and sign * a2 >= 0.0:
                gain = max(gain, a2 * a2 / e2)
            det = e1 * e2 - cross * cross
            if det > 1e-9 * e1 * e2 and e1 > 0.0:
                g1, g2 = (a1 * e2 - a2 * cross) / det, (a2 * e1 - a1 * cross) / det
                if g1 * g2 >= 0.0 and sign * g1 >= 0.0 and sign * g2 >= 0.0:
                    gain = max(gain, g1 * a1 + g2 * a2)
            out[d, j] = rest - gain
    return out
