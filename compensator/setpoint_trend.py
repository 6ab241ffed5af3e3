"""A set-point that ramps goes on: what is expected of it.

A plan that takes the set-point of this scan for the last one corrects an error of a slip jump by a
move there and most of it back, again and again. With the ramp known, one move ahead suffices.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["SetpointTrend"]

_RAMP = 4
"""Scans of one change each, of one sign and of like size, that make a ramp."""
_ALIKE = 2.0
"""Factor between the changes of one ramp: a historian's or a register's rounding varies them."""


class SetpointTrend:
    """Notices a ramp of the set-point; `push` once a scan.

    Args:
        longest: scans that a ramp is expected to go on at most.
    """

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._last = math.nan
        self._slope = 0.0
        self._run = 0

    def push(self, sp: float) -> None:
        """Take in the set-point of this scan."""
        change, self._last = sp - self._last, sp
        if math.isfinite(change) and change != 0.0 and self._goes_on(change):
            self._run += 1
            self._slope += (change - self._slope) / min(self._run, 2 * _RAMP)
        else:
            self._slope = change if math.isfinite(change) else 0.0
            self._run = int(self._slope != 0.0)

    @property
    def is_ramp(self) -> bool:
        """Whether the set-point ramps."""
        return self._run >= _RAMP

    def ahead(self, points: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return how far the set-point is expected to go by ``points`` scans from now.

        A ramp is expected to go on for as long as it has lasted.
        """
        if not self.is_ramp:
            return np.zeros(points.size)
        return self._slope * np.minimum(points, min(self._run, self._longest))

    def _goes_on(self, change: float) -> bool:
        return 1.0 / _ALIKE <= change / self._slope <= _ALIKE if self._slope != 0.0 else False
