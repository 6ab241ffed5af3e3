"""A quantity over time: points with straight lines between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["Points", "value_at", "values_over"]

Points = Sequence[tuple[float, float]]
"""``(plant second, value)`` in order of time; two points of one time make a step, and the value
holds before the first point and after the last."""


def value_at(course: Points, time: float) -> float:
    """Return the value at ``time``; after a step at that very time."""
    return float(values_over(course, np.array([time]))[0])


def values_over(course: Points, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values at ``times``, shape ``(n,)``."""
    when = np.array([point[0] for point in course])
    value = np.array([point[1] for point in course])
    right = np.searchsorted(when, times, side="right")
    left = np.maximum(right - 1, 0)
    right = np.minimum(right, when.size - 1)
    span = when[right] - when[left]
    share = np.divide(times - when[left], span, out=np.zeros_like(times), where=span > 0.0)
    values: NDArray[np.float64] = value[left] + np.clip(share, 0.0, 1.0) * (
        value[right] - value[left]
    )
    return values
