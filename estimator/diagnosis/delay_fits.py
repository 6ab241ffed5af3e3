"""The compiled inner part of `estimator.diagnosis.headroom`: a gain at each of many dead times."""

from __future__ import annotations

import numpy as np

from compiled import innermost, kernel
from estimator.algebra import dot
from estimator.arrays import Array, Index

__all__ = ["fit_delays"]

_TINY = 1e-300
"""Keeps logarithms and quotients of nothing finite."""
_LANES = 16
"""Dead times come in groups of so many, those that nobody asked for too: whole lanes."""


@kernel
def fit_delays(
    y: Array, u: Array, process: tuple[float, float, float], top: Array, bottom: Array, late: int,
    first: int, drifts: bool, out: Index,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Fit PV by OP behind a lag and each dead time, level (and straight line) left free.

    Args:
        y: PV, ``(n,)``; u: OP, ``(n,)``.
        process: pole of the lag, its first step's share of the gain, and a second lag's pole or 0.
        top, bottom: the filter that whitens what is left, both ``(m + 1,)``, 1 first; three poles
            at most.
        late: dead times, from 1 sample on.
        first: samples in which the filters settle, left out; at least ``late``.
        drifts: whether a straight line is free beside the level.
        out: samples behind the first that do not count, ``(k,)``: what is whitened is left out
            there, and goes on behind as it is.

    Returns:
        Sum of squares that is left, gain, and power of the whitened answer, each ``(late,)``.
    """
    n = y.size
    signals = np.empty((3 + drifts, n))
    _whiten(y, u, process, top, bottom, signals)
    answer, kept = signals[0], signals[1:]
    for k in out:
        kept[:, k] = 0.0
    target, levels = kept[0], kept[1:]
    for j in range(levels.shape[0]):
        for i in range(j):
            levels[j] -= dot(levels[i, first:], levels[j, first:]) * levels[i]
        levels[j] /= np.sqrt(dot(levels[j, first:], levels[j, first:]) + _TINY)
        target -= dot(levels[j, first:], target[first:]) * levels[j]
    along = _products(kept, answer, first, late)
    powers = _powers(answer, first, late)
    for k in out:
        for d in range(late):
            powers[d] -= answer[k - 1 - d] ** 2
    for j in range(levels.shape[0]):
        powers -= along[1 + j] ** 2
    powers = np.maximum(powers, _TINY)
    whole = dot(target[first:], target[first:])
    return np.maximum(whole - along[0] ** 2 / powers, _TINY), along[0] / powers, powers


Eight = tuple[float, float, float, float, float, float, float, float]


@innermost
def _add_rows(
    sums: Array, others: Array, q: Eight, p: Eight, r0: Array, r1: Array, r2: Array, r3: Array,
    r4: Array, r5: Array, r6: Array, r7: Array,
) -> None:  # fmt: skip
    """Add eight rows, one after the other, to sums with factors ``q``, and to others with ``p``."""
    for i in range(sums.size):
        total = sums[i] + q[0] * r0[i] + q[1] * r1[i] + q[2] * r2[i] + q[3] * r3[i]
        sums[i] = total + q[4] * r4[i] + q[5] * r5[i] + q[6] * r6[i] + q[7] * r7[i]
        total = others[i] + p[0] * r0[i] + p[1] * r1[i] + p[2] * r2[i] + p[3] * r3[i]
        others[i] = total + p[4] * r4[i] + p[5] * r5[i] + p[6] * r6[i] + p[7] * r7[i]


@kernel
def _eight(s: Array, k: int) -> Eight:
    return s[k], s[k + 1], s[k + 2], s[k + 3], s[k + 4], s[k + 5], s[k + 6], s[k + 7]


@kernel
def _products(signals: Array, answer: Array, first: int, late: int) -> Array:
    """Scalar products ``(m, late)`` of signals ``(m, n)`` with the answer 1, 2... samples later.

    A dead time a lane, the longest first: neighbours in the lanes are neighbours in time. There are
    more lanes than dead times, as many as the processor takes at once.
    """
    count, n = signals.shape
    wide = min(first, _LANES * -(-late // _LANES))
    # one row more for an odd number of signals: they are taken in pairs
    sums = np.zeros((count + count % 2, wide))
    k = first
    while k + 8 <= n:
        at = answer[k - wide :]
        for j in range(0, count, 2):
            q, p = _eight(signals[j], k), _eight(signals[min(j + 1, count - 1)], k)
            _add_rows(
                sums[j], sums[j + 1], q, p, at, at[1:], at[2:], at[3:], at[4:], at[5:], at[6:],
                at[7:],
            )  # fmt: skip
        k += 8
    while k < n:
        past = answer[k - wide : k]
        for j in range(count):
            value, now = signals[j, k], sums[j]
            for i in range(wide):
                now[i] += value * past[i]
        k += 1
    return sums[:count, ::-1][:, :late].copy()


@kernel
def _powers(answer: Array, first: int, late: int) -> Array:
    """Power of the answer 1, 2... samples later: each has one sample more, and one less."""
    n = answer.size
    powers = np.empty(late)
    powers[0] = dot(answer[first - 1 : n - 1], answer[first - 1 : n - 1])
    for d in range(1, late):
        powers[d] = powers[d - 1] + answer[first - 1 - d] ** 2 - answer[n - 1 - d] ** 2
    return powers


@kernel
def _whiten(
    y: Array, u: Array, process: tuple[float, float, float], top: Array, bottom: Array, out: Array
) -> None:
    """OP behind the process, PV from its first value on, a level and a straight line, whitened.

    They are the rows of ``out`` ``(m, n)``, the line where there is room. Process and filter begin
    at rest. The signals go through side by side: one alone would wait for each of its own values.
    """
    n, order = y.size, top.size - 1
    pole, step, second = process
    t1, b1 = top[1], bottom[1]
    t2, b2 = (top[2], bottom[2]) if order > 1 else (0.0, 0.0)
    t3, b3 = (top[3], bottom[3]) if order > 2 else (0.0, 0.0)
    v = x = x1 = x2 = x3 = y1 = y2 = y3 = z1 = z2 = z3 = 0.0
    for k in range(n):
        v = pole * v + step * (u[k] - u[0])
        x = second * x + (1.0 - second) * v
        w = y[k] - y[0]
        a, b, c = x + x1, w + y1, 1.0 + z1
        x1, y1, z1 = x2 + t1 * x - b1 * a, y2 + t1 * w - b1 * b, z2 + t1 - b1 * c
        x2, y2, z2 = x3 + t2 * x - b2 * a, y3 + t2 * w - b2 * b, z3 + t2 - b2 * c
        x3, y3, z3 = t3 * x - b3 * a, t3 * w - b3 * b, t3 - b3 * c
        out[0, k], out[1, k], out[2, k] = a, b, c
    if out.shape[0] > 3:
        x1 = x2 = x3 = 0.0
        for k in range(n):
            x = k / n
            a = x + x1
            x1 = x2 + t1 * x - b1 * a
            x2 = x3 + t2 * x - b2 * a
            x3 = t3 * x - b3 * a
            out[3, k] = a
