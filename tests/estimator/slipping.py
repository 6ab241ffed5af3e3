"""The stem of a valve of S 5, J 3 whose friction is another one at every slip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["slip_by_chance"]

Array = NDArray[np.float64]


def slip_by_chance(op: Array, spread: float, rng: np.random.Generator) -> Array:
    """The stem ``(n,)`` from 50 on; both frictions deviate by a share ``spread`` of S."""
    static, dynamic = 4.0, 1.0
    stem, x, free = np.empty(op.size), 50.0, static
    for k, u in enumerate(op):
        if abs(u - x) > free:
            x = u - np.sign(u - x) * (dynamic + spread * 5.0 * rng.normal())
            free = static + spread * 5.0 * rng.normal()
        stem[k] = x
    return stem
