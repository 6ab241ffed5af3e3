"""What a historian leaves of a signal: stored by exception, compressed, decimated, with holes."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["compress", "draw_holes", "draw_spikes", "hold"]

Floats = NDArray[np.float64]


@njit(cache=True)
def hold(signal, deviation):  # type: ignore[no-untyped-def]
    """Compress by exception: hold a sample until one differs from it by more than `deviation`."""
    out = np.empty_like(signal)
    last = signal[0]
    for k in range(len(signal)):
        if abs(signal[k] - last) > deviation:
            last = signal[k]
        out[k] = last
    return out


@njit(cache=True)
def compress(signal, deviation, longest):  # type: ignore[no-untyped-def]
    """Swinging-door compression, read back by linear interpolation.

    A sample is stored when no straight line from the last stored one passes all samples since
    within `deviation`, at the latest after `longest` samples.
    """
    n = len(signal)
    out = signal.copy()
    start = 0
    upper, lower = np.inf, -np.inf
    k = 1
    while k < n:
        span = k - start
        upper = min(upper, (signal[k] + deviation - signal[start]) / span)
        lower = max(lower, (signal[k] - deviation - signal[start]) / span)
        if lower > upper or span > longest or k == n - 1:
            end = k - 1 if (lower > upper or span > longest) and span > 1 else k
            for j in range(start + 1, end):
                share = (j - start) / (end - start)
                out[j] = signal[start] + share * (signal[end] - signal[start])
            start = end
            upper, lower = np.inf, -np.inf
            k = end
        k += 1
    return out


def draw_holes(rng: np.random.Generator, samples: int, share: float) -> NDArray[np.bool_]:
    """Runs of 3 to 40 missing samples until `share` of them is missing."""
    missing = np.zeros(samples, dtype=bool)
    while missing.mean() < share:
        at = int(rng.integers(0, samples))
        missing[at : at + int(rng.integers(3, 41))] = True
    return missing


def draw_spikes(rng: np.random.Generator, samples: int, size: float) -> Floats:
    """Single samples far off, three to thirty a thousand, by one to ten times `size`."""
    found = np.zeros(samples)
    count = max(1, int(samples * rng.uniform(0.003, 0.03)))
    at = rng.choice(samples, count, replace=False)
    found[at] = size * rng.uniform(1.0, 10.0, count) * rng.choice([-1.0, 1.0], count)
    return found
