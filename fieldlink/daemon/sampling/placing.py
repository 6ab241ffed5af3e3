"""Which slot a sample belongs to: by the clock, or by the controller's own cycle counter.

With a counter every cycle of the controller has its number, so polling about twice a period finds
each of them exactly once, whatever the jitter: the same number again is a duplicate, a larger step
is a gap of known length. Without one, a sample belongs to the beat in which it was read.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

__all__ = ["BeatPlacer", "CounterPlacer", "Place", "Placed", "Placer"]


CATCH_UP = 500.0
"""Counts that a controller may catch up between two polls."""


class Place(Enum):
    """What a sample turned out to be."""

    NEXT = "a new sample"
    DUPLICATE = "a sample that is in the window already"
    RESTARTED = "a new sample after the controller's counter began anew; the gap is estimated"


@dataclass(frozen=True, slots=True)
class Placed:
    """A sample's slot and how it was found."""

    slot: int
    place: Place


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
        return Placed(slot, Place.NEXT)


class CounterPlacer:
    """Slots by a counter that counts controller cycles: the first slot is the first count.

    Args:
        period: plant seconds between two counts.
        modulus: where the counter wraps to zero, e.g. 65536; infinite when it does not.
    """

    def __init__(self, period: float, modulus: float = math.inf) -> None:
        self._period = period
        self._modulus = modulus
        self._last: tuple[float, float] | None = None
        self._slot = 0

    def place(self, now: float, counter: float) -> Placed:
        """Return the slot of the count.

        A step back, or one far beyond what the elapsed time allows, means that the counter began
        anew: then the gap is as long as the time that went by. A controller that stood still for a
        moment and catches up is no restart, its counts are the truth.
        """
        if self._last is None:
            self._last = (now, counter)
            self._slot = round(counter)
            return Placed(self._slot, Place.NEXT)
        then, before = self._last
        step = counter - before
        if math.isfinite(self._modulus):
            step %= self._modulus
        if step == 0:
            return Placed(self._slot, Place.DUPLICATE)
        self._last = (now, counter)
        elapsed = (now - then) / self._period
        if 0 < step <= max(2.0 * elapsed, CATCH_UP):
            self._slot += round(step)
            return Placed(self._slot, Place.NEXT)
        self._slot += max(1, round(elapsed))
        return Placed(self._slot, Place.RESTARTED)
