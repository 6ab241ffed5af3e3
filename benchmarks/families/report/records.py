"""How a historian changes a signal: holding, compression, decimation, gaps, coarse converters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from compiled import kernel

__all__ = ["hold_by_exception", "lose_samples", "quantise", "store_box_car", "store_swinging_door"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Rng = np.random.Generator


def quantise(signal: Array, step: float) -> Array:
    """Return ``signal`` as a converter with the resolution ``step`` reads it."""
    return np.asarray(np.round(signal / step) * step)


@kernel
def hold_by_exception(signal: Array, band: float, longest: int) -> tuple[Array, Flags]:
    """The last stored value until the signal leaves it by ``band`` or ``longest`` samples pass.

    Returns the record and which samples were stored, shape ``(n,)`` each.
    """
    out, kept = np.empty(signal.size), np.zeros(signal.size, dtype=np.bool_)
    last, since = signal[0], 0
    kept[0] = True
    for k in range(signal.size):
        since += 1
        if abs(signal[k] - last) > band or since >= longest:
            last, since = signal[k], 0
            kept[k] = True
        out[k] = last
    return out, kept


@kernel
def store_swinging_door(signal: Array, band: float, longest: int) -> tuple[Array, Flags]:
    """Swinging-door compression (Bristol, 1990), read back by straight lines.

    A sample is stored when the line from the last stored one to the sample after it would leave
    ``band`` around a sample between, so that the record is never further off than that.
    """
    n = signal.size
    kept = np.zeros(n, dtype=np.bool_)
    kept[0] = kept[n - 1] = True
    pivot = 0
    steepest, flattest = -np.inf, np.inf
    for k in range(1, n):
        run = k - pivot
        slope = (signal[k] - signal[pivot]) / run
        if (slope < steepest or slope > flattest or run > longest) and k - 1 > pivot:
            pivot, run = k - 1, 1
            kept[pivot] = True
            steepest, flattest = -np.inf, np.inf
        steepest = max(steepest, (signal[k] - band - signal[pivot]) / run)
        flattest = min(flattest, (signal[k] + band - signal[pivot]) / run)
    knots = np.flatnonzero(kept)
    return np.interp(np.arange(n), knots, signal[knots]), kept


@kernel
def store_box_car(signal: Array, band: float, longest: int) -> tuple[Array, Flags]:
    """Store a value that differs from the last stored one by ``band``; draw lines between them.

    The value before the exception is stored too, as most historians do.
    """
    n = signal.size
    kept = np.zeros(n, dtype=np.bool_)
    kept[0] = kept[n - 1] = True
    last = 0
    for k in range(1, n):
        if abs(signal[k] - signal[last]) > band or k - last >= longest:
            kept[k] = True
            if k - 1 > last:
                kept[k - 1] = True
            last = k
    knots = np.flatnonzero(kept)
    return np.interp(np.arange(n), knots, signal[knots]), kept


def lose_samples(rng: Rng, n: int, share: float) -> Flags:
    """Which of ``n`` samples are lost: about ``share``, single ones and bursts; shape ``(n,)``."""
    lost = rng.random(n) < share * rng.uniform(0.1, 0.9)
    while lost.mean() < share:
        start = int(rng.integers(0, n))
        lost[start : start + int(rng.geometric(0.08))] = True
    return np.asarray(lost)
