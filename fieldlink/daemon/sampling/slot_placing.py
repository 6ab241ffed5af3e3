"""Which slot a sample belongs to: by the clock, or by the controller's own cycle counter.

With a counter every cycle of the controller has its number, so polling about twice a period finds
each of them exactly once, whatever the jitter: the same number again is a duplicate, a larger step
is a gap of known length. Without one, a sample belongs to the beat in which it was read.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple, Protocol

__all__ = ["BeatPlacer", "CounterPlacer", "Place", "Placed", "Placer"]


CATCH_UP = 500.0
"""Counts that a controller may catch up between two polls."""

LARGEST_COUNT = 2.0**53
"""Beyond it a double cannot tell one count from the next, and no controller has counted so far: at
a thousand cycles a second it takes 285,000 years. Such a count is that of another type or order."""


WHOLE = 1e-3
"""Counts by which a count may differ from a whole number: the rounding of a scaled register."""


class Place(Enum):
    """What a sample turned out to be."""

    NEXT = "a new sample"
    DUPLICATE = "a sample that is in the window already"
    RESTARTED = "the first sample after the controller's counter started again, to be marked bad"
    NO_COUNT = "a sample whose counter holds no count: placed by the clock, to be marked bad"


class Placed(NamedTuple):
    """A sample's slot, how it was found, and plant seconds from the slot's moment to the poll's."""

    slot: int
    place: Place
    behind: float = 0.0


class Placer(Protocol):
    """Gives slots to the samples of one loop."""

    def place(self, now: float, counter: float) -> Placed:
        """Return the slot of a sample.

        Args:
            now: plant seconds at which it was due to be read.
            counter: the cycle counter read with it; ignored where there is none.
        """
        ...


class BeatPlacer:
    """Slots by the clock.

    Args:
        period: plant seconds of a slot.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._begin: float | None = None
        self._last = -1

    def place(self, now: float, counter: float) -> Placed:  # noqa: ARG002
        """Return the beat of ``now``, counted from the first sample's."""
        if self._begin is None:
            self._begin = now
        # A thousandth of a period: far above rounding, far below any jitter that matters.
        slot = math.floor((now - self._begin) / self._period + 1e-3)
        if slot <= self._last:
            return Placed(self._last, Place.DUPLICATE)
        self._last = slot
        # A slow loop that got no answer at its own beat is asked again at the next one.
        return Placed(slot, Place.NEXT, now - self._begin - slot * self._period)


class CounterPlacer:
    """Slots by a counter that counts controller cycles: the first slot is the first count.

    Args:
        period: plant seconds between two counts.
        modulus: where the counter wraps to zero, e.g. 65536; infinite when it does not.
    """

    def __init__(self, period: float, modulus: float = math.inf) -> None:
        self._period = period
        self._modulus = modulus
        self._at: float | None = None
        self._count: float | None = None
        self._slot = 0

    def place(self, now: float, counter: float) -> Placed:
        """Return the slot of the count.

        A step back, or one far beyond what the elapsed time allows, means that the counter began
        again: then the gap is as long as the time that went by. A controller that stood still for a
        moment and catches up is not a restart, its counts are the truth. A number with a fraction
        is no count, as little as one that is too large.
        """
        if not (abs(counter) <= LARGEST_COUNT and abs(counter - round(counter)) <= WHOLE):
            return self._place_by_clock(now)
        counter = round(counter)
        then, before = self._at, self._count
        if then is None:
            self._at, self._count, self._slot = now, counter, round(counter)
            return Placed(self._slot, Place.NEXT)
        elapsed = (now - then) / self._period
        # Without a count before, it is as if the counter had started again.
        step = math.inf if before is None else counter - before
        if before is not None and math.isfinite(self._modulus):
            step %= self._modulus
        if step == 0:
            return Placed(self._slot, Place.DUPLICATE)
        self._at, self._count = now, counter
        if 0 < step <= max(2.0 * elapsed, CATCH_UP):
            self._slot += round(step)
            return Placed(self._slot, Place.NEXT)
        self._slot += max(1, round(elapsed))
        return Placed(self._slot, Place.RESTARTED)

    def _place_by_clock(self, now: float) -> Placed:
        if self._at is None:
            self._at = now
            return Placed(self._slot, Place.NO_COUNT)
        passed = math.floor((now - self._at) / self._period + 1e-3)
        if passed < 1:
            return Placed(self._slot, Place.DUPLICATE)
        self._at, self._count = self._at + passed * self._period, None
        self._slot += passed
        return Placed(self._slot, Place.NO_COUNT)
