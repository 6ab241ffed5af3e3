"""The compiled inner part of `estimator.diagnosis.headroom`: a gain at each of many dead times."""

from __future__ import annotations

import numpy as np

from compiled import kernel
from estimator.algebra import dot
from estimator.arrays import Array
from estimator.lanes import respond_one

__all__ = ["fit_delays", "power_of_load"]

_TINY = 1e-300
"""Keeps logarithms and quotients of nothing finite."""


@kernel
def power_of_load(poles: Array) -> float:
    """Sum of squares of the first 2,000 samples of a load's answer to one pulse.

    Args:
        poles: the load's denominator, ``(m + 1,)``, 1 first. An integrator's answer does not end.
    """
    order = poles.size - 1
    past = np.zeros(order)
    total = 0.0
    for k in range(2000):
        now = 1.0 if k == 0 else 0.0
        for i in range(order):
            now -= poles[1 + i] * past[i]
        for i in range(order - 1, 0, -1):
            past[i] = past[i - 1]
        past[0] = now
        total += now * now
    return total


@kernel
def fit_delays(
    y: Array, u: Array, process: tuple[float, float], top: Array, bottom: Array, late: int,
    first: int, drifts: bool,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Fit PV by OP behind a lag and each dead time, level (and straight line) left free.

    Args:
        y: PV, ``(n,)``; u: OP, ``(n,)``.
        process: pole of the lag, and its first step's share of the gain.
        top, bottom: the filter that whitens what is left, both ``(m + 1,)``, 1 first.
        late: dead times, from 1 sample on.
        first: samples in which the filters settle, left out; at least ``late``.
        drifts: whether a straight line is free beside the level.

    Returns:
        Sum of squares that is left, gain, and power of the whitened answer, each ``(late,)``.
    """
    n = y.size
    target = _whitened(y - y[0], top, bottom)
    answer = _whitened(respond_one(u, process[0], 0.0, 0.0, process[1]), top, bottom)
    levels = np.zeros((1 + drifts, n))
    levels[0] = _whitened(np.ones(n), top, bottom)
    if drifts:
        levels[1] = _whitened(np.arange(n) / n, top, bottom)
    for j in range(levels.shape[0]):
        for i in range(j):
            levels[j] -= dot(levels[i, first:], levels[j, first:]) * levels[i]
        levels[j] /= np.sqrt(dot(levels[j, first:], levels[j, first:]) + _TINY)
        target -= dot(levels[j, first:], target[first:]) * levels[j]
    along, powers = np.zeros(late), np.zeros(late)
    _add_products(target, answer, first, along)
    _add_powers(answer, first, powers)
    shared = np.zeros(late)
    for j in range(levels.shape[0]):
        shared[:] = 0.0
        _add_products(levels[j], answer, first, shared)
        powers -= shared**2
    powers = np.maximum(powers, _TINY)
    whole = dot(target[first:], target[first:])
    return np.maximum(whole - along**2 / powers, _TINY), along / powers, powers


@kernel
def _add_products(one: Array, answer: Array, first: int, sums: Array) -> None:
    """Add the scalar products with the answer 1, 2... samples later; a dead time a lane."""
    for k in range(first, one.size):
        for d in range(sums.size):
            sums[d] += one[k] * answer[k - 1 - d]


@kernel
def _add_powers(answer: Array, first: int, sums: Array) -> None:
    """Add the power of the answer 1, 2... samples later."""
    for k in range(first, answer.size):
        for d in range(sums.size):
            sums[d] += answer[k - 1 - d] ** 2


@kernel
def _whitened(signal: Array, top: Array, bottom: Array) -> Array:
    """A signal ``(n,)`` through a filter that begins at rest."""
    order = top.size - 1
    kept = np.zeros(order + 1)
    out = np.empty(signal.size)
    for k in range(signal.size):
        out[k] = signal[k] + kept[0]
        for i in range(order):
            kept[i] = kept[i + 1] + top[i + 1] * signal[k] - bottom[i + 1] * out[k]
    return out
