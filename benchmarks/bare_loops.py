"""What the hardware allows: bare multiply-add loops over the lanes that the kernels use.

`streamed` does one fused multiply-add for each candidate and sample and writes the result to
memory, as a stored signal does; `in_cache` does the same on accumulators that stay in the cache,
and is about the most that one core can do.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["in_cache", "streamed"]

Array = NDArray[np.float64]


@njit("void(f8[:, ::1], f8, f8[:, ::1])", cache=True, fastmath=True, error_model="numpy")
def streamed(signal: Array, factor: float, out: Array) -> None:
    """``out[k] = factor * out[k-1] + signal[k]``, shapes ``(n, m)``."""
    for k in range(1, signal.shape[0]):
        now, before, x = out[k], out[k - 1], signal[k]
        for j in range(x.size):
            now[j] = factor * before[j] + x[j]


@njit("void(f8[::1], f8[::1], f8[::1])", cache=True, fastmath=True, error_model="numpy")
def in_cache(op: Array, factor: Array, total: Array) -> None:
    """``total[j] = factor[j] * total[j] + op[k]`` for ``n`` samples and ``m`` lanes."""
    for k in range(op.size):
        u = op[k]
        for j in range(total.size):
            total[j] = factor[j] * total[j] + u
