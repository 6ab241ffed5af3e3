"""Whether a controller's cycle counter counts once in the period that the site file gives.

Samples are placed by the counter, so nothing else shows a wrong `period`: every sample is good, and
every time constant of the model that is identified is wrong by one factor.
"""

from __future__ import annotations

__all__ = ["CounterRate"]

STRETCH = 50
"""Periods over which counts are compared with the clock: a count more or less is 2 % of them."""

TOLERANCE = 1.2
"""Factor up to which the time between two counts may differ from the period. The compensator bears
a gain and a dead time that are wrong by as much (docs/compensation.md), and a controller whose
cycles are a little long is one that works."""


class CounterRate:
    """Compares the counts of one loop with the clock, stretch by stretch.

    One stretch proves nothing: a controller may have stood still, or caught up. Two in a row that
    say the same are believed, and one that is right ends it.

    Args:
        period: plant seconds that should be between two counts.

    Attributes:
        counted_every: plant seconds between two counts; None while that is the period, or unknown.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._begin: tuple[float, int] | None = None
        self._before: float | None = None
        self.counted_every: float | None = None

    def note(self, now: float, slot: int) -> None:
        """Take a sample that its count has placed.

        Args:
            now: plant second at which the count was read.
            slot: of the sample; it rises with the count.
        """
        if self._begin is None:
            self._begin = now, slot
            return
        since, first = self._begin
        if now - since < STRETCH * self._period or slot <= first:
            return
        every, self._begin = (now - since) / (slot - first), (now, slot)
        before, self._before = self._before, every
        if _is_near(every, self._period):
            self.counted_every = None
        elif before is not None and _is_near(every, before):
            self.counted_every = every

    def start_again(self) -> None:
        """Forget the stretch: the counter has started again, or was no count."""
        self._begin = None


def _is_near(one: float, other: float) -> bool:
    return 1.0 / TOLERANCE <= one / other <= TOLERANCE
