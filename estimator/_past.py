"""What one step ahead is explained by PV's own past, taken out once for all stems."""

from __future__ import annotations

import numpy as np

from estimator._kernels import Array, kernel, lagged
from estimator._response import orthonormal

__all__ = ["past_of", "slip_table", "unexplained"]


def past_of(y: Array, past: int, weight: Array) -> Array:
    """A constant and PV (``(n,)``) later by 1 to ``past`` samples, weighted, ``(past + 1, n)``."""
    return np.vstack([weight, lagged(y, 1, past, weight)])


def unexplained(y: Array, weight: Array, past: Array) -> Array:
    """PV without its past, and the past made orthonormal, ``(rows + 1, n)``."""
    basis: Array = orthonormal(past.copy())
    target = y * weight
    return np.vstack([target - (basis @ target) @ basis, basis])


@kernel
def slip_table(rows: Array, weight: Array, first: int, later: int, m: int) -> Array:
    """What least squares needs of a slip at each of ``m`` samples, ``(m, (1 + later) * (r + 1))``.

    For the ``rows``, ``(r, n)``: their sums from ``first`` samples later on, then themselves there
    and at the samples after it, ``later`` in all; last the weights, likewise.
    """
    r, n = rows.shape
    total = np.zeros((n + 1, r + 1))
    for t in range(n - 1, -1, -1):
        for i in range(r):
            total[t, i] = total[t + 1, i] + rows[i, t]
        total[t, r] = total[t + 1, r] + weight[t]
    out = np.zeros((m, (1 + later) * (r + 1)))
    for k in range(m):
        now = out[k]
        t = min(k + first, n)
        for i in range(r):
            now[i] = total[t, i]
        now[(1 + later) * r] = total[t, r]
        for j in range(min(later, n - t)):
            for i in range(r):
                now[(1 + j) * r + i] = rows[i, t + j]
            now[(1 + later) * r + 1 + j] = weight[t + j]
    return out
