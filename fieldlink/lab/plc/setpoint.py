"""The set-point of a simulated loop over time."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

__all__ = ["SetpointProfile"]


class SetpointProfile:
    """A set-point in steps.

    Args:
        steps: ``(plant seconds, value)`` in order of time, at least one; the first value holds
            before its time as well.
    """

    def __init__(self, steps: Sequence[tuple[float, float]]) -> None:
        self._times = [time for time, _ in steps]
        self._values = [value for _, value in steps]

    def at(self, time: float) -> float:
        """Return the set-point at ``time`` (plant seconds)."""
        return self._values[max(0, bisect_right(self._times, time) - 1)]
