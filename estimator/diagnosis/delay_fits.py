"""The compiled inner part of `estimator.diagnosis.headroom`: a gain at each of many dead times."""

from __future__ import annotations

import numpy as np

from compiled import kernel
from estimator.algebra import dot
from estimator.arrays import Array
from estimator.lanes import respond_one

__all__ = ["fit_delays"]

_TINY = 1e-300
"""Keeps logarithms and quotients of nothing finite."""


@kernel
def fit_delays(
    y: Array, u: Array, process: tuple[float, float, float], top: Array, bottom: Array, late: int,
    first: int, drifts: bool,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Fit PV by OP behind a lag and each dead time, level (and straight line) left free.

    Args:
        y: PV, ``(n,)``; u: OP, ``(n,)``.
        process: pole of the lag, its first step's share of the gain, and a second lag's pole or 0.
        top, bottom: the filter that whitens what is left, both ``(m + 1,)``, 1 first.
        late: dead times, from 1 sample on.
        first: samples in which the filters settle, left out; at least ``late``.
        drifts: whether a straight line is free beside the level.

    Returns:
        Sum of squares that is left, gain, and power of the whitened answer, each ``(late,)``.
    """
    n = y.size
    signals = np.empty((3 + drifts, n))
    signals[0] = y - y[0]
    signals[1] = respond_one(u, process[0], 0.0, process[2], process[1])
    signals[2] = 1.0
    if drifts:
        signals[3] = np.arange(n) / n
    _whiten(signals, top, bottom)
    target, answer, levels = signals[0], signals[1], signals[2:]
    for j in range(levels.shape[0]):
        for i in range(j):
            levels[j] -= dot(levels[i, first:], levels[j, first:]) * levels[i]
        levels[j] /= np.sqrt(dot(levels[j, first:], levels[j, first:]) + _TINY)
        target -= dot(levels[j, first:], target[first:]) * levels[j]
    along = _products(target, answer, first, late)
    powers = _powers(answer, first, late)
    for j in range(levels.shape[0]):
        powers -= _products(levels[j], answer, first, late) ** 2
    powers = np.maximum(powers, _TINY)
    whole = dot(target[first:], target[first:])
    return np.maximum(whole - along**2 / powers, _TINY), along / powers, powers


@kernel
def _products(one: Array, answer: Array, first: int, late: int) -> Array:
    """Scalar products with the answer 1, 2... samples later; a dead time a lane."""
    sums = np.zeros(late)
    for k in range(first, one.size):
        # the longest dead time first: neighbours in the lanes are neighbours in time
        value, past = one[k], answer[k - late : k]
        for i in range(late):
            sums[i] += value * past[i]
    return sums[::-1].copy()


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
def _whiten(signals: Array, top: Array, bottom: Array) -> None:
    """Signals ``(m, n)`` in place through a filter that begins at rest, one beside the other."""
    count, n = signals.shape
    order = top.size - 1
    kept = np.zeros((order + 1, count))
    for k in range(n):
        for j in range(count):
            now = signals[j, k]
            out = now + kept[0, j]
            signals[j, k] = out
            for i in range(order):
                kept[i, j] = kept[i + 1, j] + top[i + 1] * now - bottom[i + 1] * out
