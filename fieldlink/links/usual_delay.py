"""How late values usually come: what is always alike shifts no sample from another.

Devices that share a line take turns, so that a loop's turn may always come late in its period. A
silent neighbour, on the other hand, delays a few of its samples by half a period or more. And a
server's clock may differ from ours: only how much later than usual a report is can be told.
"""

from __future__ import annotations

from collections import deque
from statistics import median

__all__ = ["UsualDelay"]

REMEMBERED = 15
"""Delays of which the middle one is the usual: a silent neighbour, which is asked after pauses of
several periods, delays less than half of them; a line that has changed is learned in eight."""


class UsualDelay:
    """The latest delays of one loop, or of one server's reports, in seconds."""

    def __init__(self) -> None:
        self._latest: deque[float] = deque(maxlen=REMEMBERED)

    def exceed(self, delay: float) -> float:
        """Note a delay, and return by how much it is longer than usual; 0 for the first."""
        usual = median(self._latest) if self._latest else delay
        self._latest.append(delay)
        return delay - usual
