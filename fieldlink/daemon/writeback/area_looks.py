"""When the exchange areas of a device's loops are looked at, and those that do not answer.

A request without an answer takes the device from its polling for a time-out, and ends a connection.
So an area that costs that is looked at after pauses that double. It stands behind the areas that
answer, and all such areas of a device take turns: together they cost what one would.
"""

from __future__ import annotations

import math

from fieldlink.links import LinkError, LinkPausedError, LinkTimeoutError, LinkUnreachableError
from fieldlink.registers import HEARTBEAT_EVERY

__all__ = ["AreaLooks"]

LONGEST = 4.0 * HEARTBEAT_EVERY
"""The longest pause, in plant seconds.

An area that answers again is to be served at once: readers call a heartbeat dead after ten seconds,
and one that was silent for less than a pause should not be. Where a look takes long, the pause is
longer (`LONGEST_SHARE`); the heartbeat of such an area is dead already.
"""

LONGEST_SHARE = 0.05
"""The share of time that looks without an answer may take."""


class AreaLooks:
    """Knows which loops' areas do not answer while their device does, and when one is next.

    Args:
        timeout: plant seconds that a request without an answer takes.
    """

    def __init__(self, timeout: float) -> None:
        self._longest = max(LONGEST, timeout / LONGEST_SHARE)
        self._silent: list[str] = []
        self._pause = HEARTBEAT_EVERY
        self._not_before = -math.inf

    def is_silent(self, loop: str) -> bool:
        """Whether the loop's area did not answer when it was last looked at."""
        return loop in self._silent

    def next_silent(self, now: float) -> str | None:
        """Return the loop whose silent area is to be looked at now; None before the pause is over.

        Args:
            now: the plant second.
        """
        return self._silent[0] if self._silent and now >= self._not_before else None

    def note(self, loop: str, error: LinkError | None, now: float, *, answers: bool) -> None:
        """Note how a look has ended at plant second ``now``.

        Args:
            loop: whose area it was.
            error: why it failed; None when it did not.
            now: the plant second.
            answers: whether the device answers its polls; else the area is not to blame.
        """
        lost = isinstance(error, LinkTimeoutError | LinkUnreachableError)
        if not lost:
            if loop in self._silent:
                # The others may answer again as well.
                self._silent.remove(loop)
                self._pause, self._not_before = HEARTBEAT_EVERY, now
        elif loop in self._silent:
            self._silent.remove(loop)
            self._silent.append(loop)
            if answers and not isinstance(error, LinkPausedError):
                self._pause = min(2.0 * self._pause, self._longest)
            self._not_before = now + self._pause
        elif answers and not isinstance(error, LinkPausedError):
            self._silent.append(loop)
            if len(self._silent) == 1:
                self._pause, self._not_before = HEARTBEAT_EVERY, now + HEARTBEAT_EVERY
