"""How much of an error a moving set-point explains: what PV had no time or no room to follow.

PV follows a ramp of the set-point a dead time and a settling time later, and not at all beyond the
reach of OP. An error as large as the way that the set-point went meanwhile, and on the side that PV
then lags on, is nobody's fault.

Example: a set-point that ramps to 80 PV beyond what OP can reach leaves an error of 80 PV for as
long as it stays there; it says nothing against the model.
"""

from __future__ import annotations

import math
from collections import deque

__all__ = ["SetpointWay"]

_MARGIN = 1.1
"""Factor of the way that is explained: noise, and a stem that does not stop where it should."""


class SetpointWay:
    """Follows the latest changes of a set-point; `push` once a scan.

    Args:
        scans: that PV is given to arrive.
    """

    def __init__(self, scans: int) -> None:
        self._changes: deque[float] = deque(maxlen=max(1, scans))
        self._before = 0.0
        """Sum of the changes before those, while the set-point is out of reach."""

    def restart(self) -> None:
        """Forget the changes seen."""
        self._changes.clear()
        self._before = 0.0

    def push(self, change: float, *, out_of_reach: bool) -> None:
        """Take in a change of the set-point; while it is out of OP's reach nothing is forgotten."""
        if len(self._changes) == self._changes.maxlen:
            self._before += self._changes[0]
        self._changes.append(change)
        if not out_of_reach:
            self._before = 0.0

    def explains(self, error: float) -> float:
        """Return how much of an error, PV minus SP, the way of the set-point explains, in PV."""
        way = math.fsum((self._before, *self._changes))
        return _MARGIN * abs(way) if way * error < 0.0 else 0.0
