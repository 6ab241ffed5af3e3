"""The base controller has the loop for a while, for a reason that is not the model's.

After a fault of PV, or a load that is large for the loop, the error is nobody's doing: no figures
are taken from it, and no compensator is judged by it. The recess is over after some time, once the
error is again inside the range that was known of it.
"""

from __future__ import annotations

__all__ = ["Recess"]


class Recess:
    """`begin` it, then `follow` the error once a scan."""

    def __init__(self) -> None:
        self._left = 0
        self._returned = True

    @property
    def over(self) -> bool:
        """Whether the compensator may take over again."""
        return self._returned

    def begin(self, scans: int) -> None:
        """Begin, or begin again, for ``scans`` at least."""
        self._left = max(self._left, scans)
        self._returned = False

    def follow(self, error: float, largest: float) -> None:
        """Take in a scan.

        Args:
            error: PV minus SP, NaN when bad.
            largest: error known; infinity where none is.
        """
        self._left = max(0, self._left - 1)
        if self._left == 0 and (self._returned or abs(error) <= largest):
            self._returned = True
