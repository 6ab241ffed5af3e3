"""The clock of a link: the machine's own, or one that only a simulation moves.

Deadlines and ages use ``monotonic`` alone, so a wall clock that steps changes no sampling;
``utc`` is what is stored and shown.
"""

from __future__ import annotations

import asyncio
import time
from typing import Protocol

__all__ = ["Clock", "SystemClock", "VirtualClock"]


class Clock(Protocol):
    """Seconds, and a way to wait for them."""

    def monotonic(self) -> float:
        """Seconds since some moment; never steps."""
        ...

    def utc(self) -> float:
        """Seconds since 1970-01-01 00:00 UTC; may step."""
        ...

    async def sleep_until(self, moment: float) -> None:
        """Return when ``monotonic()`` has reached ``moment``."""
        ...


class SystemClock:
    """The machine's clock."""

    def monotonic(self) -> float:
        """Seconds of the machine's monotonic clock."""
        return time.monotonic()

    def utc(self) -> float:
        """Seconds of the machine's wall clock."""
        return time.time()

    async def sleep_until(self, moment: float) -> None:
        """Sleep; return at once when ``moment`` has passed."""
        await asyncio.sleep(max(0.0, moment - time.monotonic()))


class VirtualClock:
    """A clock that stands until it is moved, for lockstep runs and tests.

    Args:
        start_utc: the UTC second at which the simulation begins.
    """

    def __init__(self, start_utc: float = 0.0) -> None:
        self._start_utc = start_utc
        self._now = 0.0

    def monotonic(self) -> float:
        """Seconds since the simulation began."""
        return self._now

    def utc(self) -> float:
        """The start plus the simulated seconds."""
        return self._start_utc + self._now

    def advance_to(self, moment: float) -> None:
        """Move the clock to ``moment`` seconds after the start; it never moves back."""
        self._now = max(self._now, moment)

    async def sleep_until(self, moment: float) -> None:
        """Let other tasks run, then jump to ``moment``."""
        await asyncio.sleep(0)
        self.advance_to(moment)
