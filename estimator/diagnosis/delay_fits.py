"""The compiled inner part of `estimator.diagnosis.headroom`: a gain at each of many dead times."""

from __future__ import annotations

import numpy as np

from compiled import innermost, kernel
from estimator.algebra import dot
from estimator.arrays import Array
from estimator.lanes import respond_one

__all__ = ["fit_delays"]

_TINY = 1e-300
"""Keeps logarithms and quotients of nothing finite."""
_LANES = 16
"""Dead times come in groups of so many, those that nobody asked for too: whole lanes."""


@kernel
def fit_delays(
    y: Array, u: Array, process: tuple[float, float, float], top: Array, bottom: Array, late: int,
    first: int, drifts: bool,
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

    Returns:
        Sum of squares that is left, gain, and power of the whitened answer, each ``(late,)``.
    """
    n = y.size
    signals = np.empty((3 + drifts, n))
    answer = respond_one(u, process[0], 0.0, process[2], process[1])
    _whiten(y, answer, top, bottom, signals)
    answer, kept = signals[0], signals[1:]
    target, levels = kept[0], kept[1:]
    for j in range(levels.shape[0]):
        for i in range(j):
            levels[j] -= dot(levels[i, first:], levels[j, first:]) * levels[i]
        levels[j] /= np.sqrt(dot(levels[j, first:], levels[j, first:]) + _TINY)
        target -= dot(levels[j, first:], target[first:]) * levels[j]
    along = _products(kept, answer, first, late)
    powers = _powers(answer, first, late)
    for j in range(levels.shape[0]):
        powers -= along[1 + j] ** 2
    powers = np.maximum(powers, _TINY)
    whole = dot(target[first:], target[first:])
    return np.maximum(whole - along[0] ** 2 / powers, _TINY), along[0] / powers, powers


@innermost
def _add_rows(
    sums: Array,
    q: tuple[float, float, float, float],
    p: tuple[float, float, float, float],
    r0: Array,
    r1: Array,
    r2: Array,
    r3: Array,
    r4: Array,
    r5: Array,
    r6: Array,
    r7: Array,
) -> None:
    """Add eight rows, one after the other, each times a factor: four of ``q``, four of ``p``."""
    for i in range(sums.size):
        total = sums[i] + q[0] * r0[i] + q[1] * r1[i] + q[2] * r2[i] + q[3] * r3[i]
        sums[i] = total + p[0] * r4[i] + p[1] * r5[i] + p[2] * r6[i] + p[3] * r7[i]


@kernel
def _products(signals: Array, answer: Array, first: int, late: int) -> Array:
    """Scalar products ``(m, late)`` of signals ``(m, n)`` with the answer 1, 2... samples later.

    A dead time a lane, the longest first: neighbours in the lanes are neighbours in time. There are
    more lanes than dead times, as many as the processor takes at once.
    """
    count, n = signals.shape
    wide = min(first, _LANES * -(-late // _LANES))
    sums = np.zeros((count, wide))
    k = first
    while k + 8 <= n:
        at = answer[k - wide :]
        for j in range(count):
            s = signals[j, k : k + 8]
            q, p = (s[0], s[1], s[2], s[3]), (s[4], s[5], s[6], s[7])
            _add_rows(
                sums[j], q, p, at, at[1:], at[2:], at[3:], at[4:], at[5:], at[6:], at[7:]
            )  # fmt: skip
        k += 8
    while k < n:
        past = answer[k - wide : k]
        for j in range(count):
            value, now = signals[j, k], sums[j]
            for i in range(wide):
                now[i] += value * past[i]
        k += 1
    return sums[:, ::-1][:, :late].copy()


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
def _whiten(y: Array, answer: Array, top: Array, bottom: Array, out: Array) -> None:
    """The answer, PV from its first value on, a level and a straight line, whitened: rows of
    ``out`` ``(m, n)``; the line where there is room.

    The filter begins at rest. The signals go through it side by side: one alone would wait for
    each of its own values.
    """
    n, order = y.size, top.size - 1
    t1, b1 = top[1], bottom[1]
    t2, b2 = (top[2], bottom[2]) if order > 1 else (0.0, 0.0)
    t3, b3 = (top[3], bottom[3]) if order > 2 else (0.0, 0.0)
    x1 = x2 = x3 = y1 = y2 = y3 = z1 = z2 = z3 = 0.0
    for k in range(n):
        x, v = answer[k], y[k] - y[0]
        a, b, c = x + x1, v + y1, 1.0 + z1
        x1, y1, z1 = x2 + t1 * x - b1 * a, y2 + t1 * v - b1 * b, z2 + t1 - b1 * c
        x2, y2, z2 = x3 + t2 * x - b2 * a, y3 + t2 * v - b2 * b, z3 + t2 - b2 * c
        x3, y3, z3 = t3 * x - b3 * a, t3 * v - b3 * b, t3 - b3 * c
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
