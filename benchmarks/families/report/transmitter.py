"""What a failing transmitter makes of PV: the controller sees it, and answers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.families.report.scenario import log_uniform

__all__ = ["add_spikes", "freeze"]

Array = NDArray[np.float64]
Rng = np.random.Generator


def add_spikes(rng: Rng, noise: Array, swing: float) -> None:
    """Add single samples far off, as a loose wire makes them, to ``noise`` ``(n,)`` in place.

    One of 50 to 500 samples, by half to twenty times PV's deviation ``swing``, all of one size
    within a factor of two.
    """
    at = rng.choice(noise.size, max(1, int(noise.size / log_uniform(rng, 50.0, 500.0))), False)
    size = swing * log_uniform(rng, 0.5, 20.0) * rng.uniform(0.7, 1.4, at.size)
    noise[at] += size * rng.choice([-1.0, 1.0], at.size)


def freeze(rng: Rng, noise: Array, _: float) -> None:
    """Let the transmitter repeat its last value, NaN in ``noise`` ``(n,)``, for some stretches."""
    for _turn in range(int(rng.integers(1, 5))):
        begin = int(rng.integers(0, noise.size - 10))
        noise[begin : begin + int(log_uniform(rng, 10.0, 200.0))] = np.nan
