"""What the turns of an uneven wave cost: the marginal likelihood of a model with random effects.

Lengths of rises and falls, tops and bottoms are drawn from normal distributions. Their means and
deviations are those that make the window likeliest (EM), at half a log of the judged rows each, as
all other numbers: a steady wave tells them that well. Over the turns themselves the likelihood is
integrated (Laplace's approximation; Tierney and Kadane, 1986).
"""

from __future__ import annotations

import math

import numpy as np

from compiled import kernel
from estimator.algebra import cholesky, solve_spd
from estimator.arrays import Array

__all__ = ["inverse_of", "precision_of", "price_of_turns", "spread_of"]

_LEAST_TIME = 0.2
"""Least deviation of a length, in samples: what a turn between two samples is told to."""
_LEAST_HEIGHT = 0.01
"""The same of a height, as a share of the swing."""
_MOST = 0.1
"""Largest deviation of a length over a cycle, and of a height over the swing: what differs more
repeats nothing. It is a fifth of half a cycle, and of half a swing."""
_BEND = 0.5
"""Deviation of a bend: one of two halves makes a rise turn back."""
_NUMBERS = 7.0
"""Means of rises, falls, tops and bottoms, deviations of rises, of falls and of heights."""
_PHASE = 12.0
"""Over the square of a period: the precision of a first turn that may lie anywhere in one."""


@kernel
def spread_of(times: Array, heights: Array, covariance: Array) -> Array:
    """Means of both lengths and both heights, deviations of both lengths and of heights, ``(7,)``.

    ``covariance`` ``(2 m, 2 m)`` of times and heights is what the window leaves open of them.
    """
    m = times.size
    out = np.zeros(7)
    for j in range(2):
        lengths = times[j + 1 :: 2] - times[j : m - 1 : 2]
        out[j] = lengths.sum() / lengths.size
        out[2 + j] = heights[j::2].sum() / heights[j::2].size
    squares = np.zeros(3)
    for i in range(m):
        if i + 1 < m:
            open_ = covariance[i, i] + covariance[i + 1, i + 1] - 2.0 * covariance[i, i + 1]
            squares[i % 2] += (times[i + 1] - times[i] - out[i % 2]) ** 2 + open_
        squares[2] += (heights[i] - out[2 + i % 2]) ** 2 + covariance[m + i, m + i]
    for j in range(2):
        deviation = math.sqrt(squares[j] / ((m - j) // 2))
        out[4 + j] = max(min(deviation, _MOST * (out[0] + out[1])), _LEAST_TIME)
    swing = abs(out[2] - out[3])
    out[6] = max(min(math.sqrt(squares[2] / m), _MOST * swing), _LEAST_HEIGHT * swing)
    return out


@kernel
def precision_of(spread: Array, first: float, m: int, bends: int) -> tuple[Array, Array]:
    """Precision ``(p, p)`` of times, heights and bends, and that times their mean, ``(p,)``.

    ``first`` is about where the first turn lies.
    """
    p = 2 * m + bends
    out, mean = np.zeros((p, p)), np.zeros(p)
    for i in range(m - 1):
        sure = 1.0 / spread[4 + i % 2] ** 2
        out[i, i] += sure
        out[i + 1, i + 1] += sure
        out[i, i + 1] -= sure
        out[i + 1, i] -= sure
        mean[i] -= sure * spread[i % 2]
        mean[i + 1] += sure * spread[i % 2]
    anywhere = _PHASE / (spread[0] + spread[1]) ** 2
    out[0, 0] += anywhere
    mean[0] += anywhere * first
    sure = 1.0 / spread[6] ** 2
    for i in range(m):
        out[m + i, m + i] = sure
        mean[m + i] = sure * spread[2 + i % 2]
    for i in range(2 * m, p):
        out[i, i] = 1.0 / _BEND**2
    return out, mean


@kernel
def price_of_turns(at: Array, told: Array, precision: Array, mean: Array, rows: float) -> float:
    """What turns and bends ``at`` ``(p,)`` cost in nats; ``told`` is what the window tells of them.

    Log-likelihood at its maximum less the one that is integrated over them.
    """
    away = at - solve_spd(precision, mean)
    cost = 0.5 * _NUMBERS * math.log(rows)
    narrowed, prior = cholesky(told + precision), cholesky(precision)
    for i in range(at.size):
        cost += math.log(narrowed[i, i] / prior[i, i])
        for j in range(at.size):
            cost += 0.5 * away[i] * precision[i, j] * away[j]
    return cost


@kernel
def inverse_of(matrix: Array) -> Array:
    """Inverse of a symmetric positive definite matrix ``(p, p)``."""
    p = matrix.shape[0]
    root = cholesky(matrix)
    back = np.zeros((p, p))
    for c in range(p):
        for i in range(c, p):
            total = 1.0 if i == c else 0.0
            for k in range(c, i):
                total -= root[i, k] * back[k, c]
            back[i, c] = total / root[i, i]
    out = np.zeros((p, p))
    for i in range(p):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, p):
                total += back[k, i] * back[k, j]
            out[i, j] = total
            out[j, i] = total
    return out
