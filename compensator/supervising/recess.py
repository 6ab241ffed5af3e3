"""The base controller has the loop for a while, for a reason that is not the model's.

After a fault of PV, or a load that is large for the loop, the error is nobody's doing: no figures
are taken from it, and no compensator is judged by it. The recess is over after some time, once the
error has been inside the range that was known of it for as long as makes figures: an upset passes
its set-point, too.
"""

from __future__ import annotations

__all__ = ["Recess"]


class Recess:
    """`begin` it, then `follow` the error once a scan.

    Args:
        settled: scans in a row that the error must be inside the range.
        longest: scans after which the recess is over although it is not: that is how the loop is.
    """

    def __init__(self, settled: int, longest: int) -> None:
        self._settled, self._longest = settled, longest
        self._left = self._inside = self._passed = 0
        self._returned = True

    @property
    def over(self) -> bool:
        """Whether the compensator may take over again."""
        return self._returned

    def begin(self, scans: int) -> None:
        """Begin, or begin again, for ``scans`` at least."""
        self._left = max(self._left, scans)
        self._inside = self._passed = 0
        self._returned = False

    def follow(self, error: float, largest: float) -> None:
        """Take in a scan.

        Args:
            error: PV minus SP, NaN when bad.
            largest: error that belongs to the loop; infinity where none is known.
        """
        self._passed += 1
        self._left = max(0, self._left - 1)
        self._inside = self._inside + 1 if abs(error) <= largest else 0
        settled = self._inside >= self._settled or self._passed >= self._longest
        if self._left == 0 and settled:
            self._returned = True
