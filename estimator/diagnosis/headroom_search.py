"""The compiled search behind `estimator.diagnosis.headroom`: lag, loads and noise of least cost.

A search asks for a hundred fits, each of which takes a few microseconds: it is one kernel, so that
none of them waits for Python.
"""

from __future__ import annotations

import math

import numpy as np

from compiled import kernel
from estimator.arrays import Array, Index
from estimator.diagnosis.delay_fits import fit_delays
from estimator.diagnosis.innovations import poles_product, whitening_numerator

__all__ = ["Bounds", "Kind", "fit_numbers", "least_numbers", "process_poles"]

Kind = tuple[int, bool, bool, float]
"""A structure: poles of the load, whether behind the process, whether that integrates, and its
second lag over the first."""
Bounds = tuple[int, int, float]
"""Longest dead time, samples in which the filters settle, and the largest number that is tried."""

_IMPOSSIBLE = 1e12
"""Cost of numbers that fit nothing: beyond what any record has, and finite for the search."""
_LEAST_POLE = 1e-6
"""A pole below it is that of no lag at all; smaller ones only overflow in the spectral factor."""
_CLOSE, _ALIKE = 0.03, 0.1
"""A search ends where the corners of its simplex differ by no more, in numbers and in nats."""


@kernel
def process_poles(numbers: Array, kind: Kind) -> tuple[float, float, float]:
    """The pole of the process, its first step's share of the gain, and a second pole or 0."""
    _, _, integrating, ratio = kind
    if integrating:
        return 1.0, 1.0, 0.0
    pole = _pole(numbers[0])
    second = _pole(numbers[0] + math.log(ratio)) if ratio > 0.0 else 0.0
    return pole, 1.0 - pole, second


@kernel
def _pole(time: float) -> float:
    """Pole of the time constant whose logarithm, in samples, is given."""
    return max(_LEAST_POLE, math.exp(-math.exp(-time)))


@kernel
def fit_numbers(
    numbers: Array, kind: Kind, y: Array, u: Array, bounds: Bounds, out: Index
) -> tuple[Array, Array, Array]:
    """The gain at every dead time, level and straight line left free; see `fit_delays`.

    Args:
        numbers: logarithms of the lag in samples (of a process that has one), of the variance of a
            white load over the slow one's (of loads before the process), of the slow load's corner
            in samples, and of the noise's variance over the slow load's.
        kind: the structure.
        y: PV, ``(n,)``; u: OP, ``(n,)``.
        bounds: see `Bounds`.
        out: samples that do not count, ``(k,)``, behind those in which the filters settle.
    """
    order, behind, integrating, _ = kind
    process = process_poles(numbers, kind)
    poles = np.empty(order + (0 if behind else 1 + int(process[2] > 0.0)))
    # the poles of the filter that whitens load plus noise
    poles[:order] = _pole(numbers[-2])
    if not behind:
        poles[order] = process[0]
        if process[2] > 0.0:
            poles[order + 1] = process[2]
    white = 0.0 if behind else math.exp(numbers[-3])
    top, bottom = poles_product(poles), whitening_numerator(poles, math.exp(numbers[-1]), white)
    late, first, _ = bounds
    return fit_delays(y, u, process, top, bottom, late, first, integrating, out)


@kernel
def _cost(numbers: Array, kind: Kind, y: Array, u: Array, bounds: Bounds, out: Index) -> float:
    """Minus the log-likelihood of the likeliest dead time."""
    _, first, farthest = bounds
    if np.abs(numbers).max() > farthest:
        return _IMPOSSIBLE
    n = y.size - first - out.size
    return 0.5 * n * math.log(fit_numbers(numbers, kind, y, u, bounds, out)[0].min() / n)


@kernel
def least_numbers(
    corners: Array, kind: Kind, y: Array, u: Array, bounds: Bounds, out: Index, tries: int
) -> Array:
    """The numbers ``(m,)`` of least cost, from a simplex ``(m + 1, m)`` downhill.

    The method of Nelder and Mead (1965, "A simplex method for function minimization"), step by step
    as SciPy has it. It ends after ``tries`` fits.
    """
    m = corners.shape[1]
    simplex, costs = corners.copy(), np.full(m + 1, np.inf)
    tried = 0
    for i in range(m + 1):
        if tried < tries:
            costs[i] = _cost(simplex[i], kind, y, u, bounds, out)
            tried += 1
    simplex, costs = _sorted(simplex, costs)
    while tried < tries:
        if _wide(simplex) <= _CLOSE and np.abs(costs[0] - costs[1:]).max() <= _ALIKE:
            break
        middle = simplex[0].copy()
        for i in range(1, m):
            middle += simplex[i]
        middle /= m
        worst = simplex[m].copy()
        moved = 2.0 * middle - worst
        cost = _cost(moved, kind, y, u, bounds, out)
        tried += 1
        if costs[0] <= cost < costs[m - 1]:
            simplex[m], costs[m] = moved, cost
        elif tried < tries:
            # farther where it is the best so far; nearer on one side or the other
            is_best, is_better = cost < costs[0], cost < costs[m]
            if is_best:
                other = 3.0 * middle - 2.0 * worst
            elif is_better:
                other = 1.5 * middle - 0.5 * worst
            else:
                other = 0.5 * middle + 0.5 * worst
            found = _cost(other, kind, y, u, bounds, out)
            tried += 1
            if is_best and not found < cost:
                simplex[m], costs[m] = moved, cost
            elif is_best or (found <= cost if is_better else found < costs[m]):
                simplex[m], costs[m] = other, found
            else:
                for i in range(1, m + 1):
                    simplex[i] = simplex[0] + 0.5 * (simplex[i] - simplex[0])
                    if tried == tries:
                        break
                    costs[i] = _cost(simplex[i], kind, y, u, bounds, out)
                    tried += 1
        simplex, costs = _sorted(simplex, costs)
    best: Array = simplex[0].copy()
    return best


@kernel
def _wide(simplex: Array) -> float:
    """The largest distance of a corner's number from that of the first."""
    return float(np.abs(simplex[1:] - simplex[0]).max())


@kernel
def _sorted(simplex: Array, costs: Array) -> tuple[Array, Array]:
    """The corners and their costs, rising; those of one cost as they stand."""
    order: Index = np.argsort(costs, kind="mergesort")
    return simplex[order], costs[order]
