"""What all compiled loops share: how they are compiled, their array types, and linear filters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "Array",
    "Index",
    "Mask",
    "add",
    "complete",
    "filtered",
    "kernel",
    "lag",
    "lagged",
    "weighted",
]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_Function = TypeVar("_Function", bound=Callable[..., Any])


def kernel(function: _Function) -> _Function:
    """Compile a loop; the code is kept beside its source."""
    compiled = njit(cache=True, fastmath=True, error_model="numpy")(function)
    return cast("_Function", compiled)


@kernel
def lag(signal: Array, pole: float) -> Array:
    """First-order lag of unit gain, started at rest; ``pole = 1`` is an integrator started at zero.

    ``signal`` has shape ``(n,)``; so has the result. The integrator's gain is ``1 / n`` so that
    its output is of the order of its input.
    """
    gain = 1.0 - pole if pole < 1.0 else 1.0 / signal.size
    out = np.empty(signal.size)
    now = signal[0] * (1.0 if pole < 1.0 else gain)
    out[0] = now
    for k in range(1, signal.size):
        now = pole * now + gain * signal[k]
        out[k] = now
    return out


@kernel
def add(to: Array, share: float, of: Array) -> None:
    """``to += share of``, both ``(n,)``.

    Given slices, it shifts as well; a loop with shifted indices would be compiled without SIMD
    lanes, because an index may be negative.
    """
    for k in range(to.size):
        to[k] += share * of[k]


@kernel
def filtered(signal: Array, taps: Array, before: float) -> Array:
    """Moving average ``taps[0] s_k + taps[1] s_(k-1) + ...``, the signal ``(n,)`` ``before`` it."""
    n = signal.size
    out: Array = taps[0] * signal
    for i in range(1, min(taps.size, n)):
        add(out[i:], taps[i], signal[: n - i])
        if before != 0.0:
            out[:i] += taps[i] * before
    return out


@kernel
def lagged(signal: Array, first: int, count: int, weight: Array) -> Array:
    """Rows ``(count, n)``: the signal ``(n,)`` later by ``first`` samples and on, times ``weight``.

    Its first value is held before it.
    """
    n = signal.size
    rows = np.empty((count, n))
    for i in range(count):
        late = min(first + i, n)
        rows[i, :late] = signal[0]
        rows[i, late:] = signal[: n - late]
        rows[i] *= weight
    return rows


@kernel
def weighted(rows: Array, taps: Array, weight: Array) -> Array:
    """Each row of ``(k, n)`` as a moving average, its first value held before it, and weighted."""
    out = np.empty(rows.shape)
    for r in range(rows.shape[0]):
        out[r] = filtered(rows[r], taps, rows[r, 0]) * weight
    return out


@kernel
def complete(good: Mask, past: int) -> Mask:
    """Samples whose own value and the ``past`` ones before are good; shape ``(n,)``."""
    usable = good.copy()
    for i in range(1, past + 1):
        usable[i:] &= good[:-i]
    return usable
