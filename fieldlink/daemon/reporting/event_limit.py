"""A bound on events: what changes all the time is logged at first, and then once a minute.

A device behind a loose contact comes and goes a thousand times a minute. Each time is an event, and
events are kept for ever, so they would push the samples out of a bounded store.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from fieldlink.links import Clock

__all__ = ["EventLimit", "Summary"]

MOST = 10
"""Events of one kind and source in a minute; a device that comes and goes five times is logged."""

WINDOW = 60.0
"""Seconds that a summary covers."""


@dataclass(frozen=True, slots=True)
class Summary:
    """The events that were held back: kind, source and a sentence."""

    kind: str
    source: str
    message: str


@dataclass(slots=True)
class _Recent:
    begin: float
    told: int = 0
    held: int = 0
    last_at: float = 0.0
    last_kind: str = ""
    last_message: str = ""


class EventLimit:
    """Decides which events are logged one by one, and sums up the others.

    Args:
        clock: gives the minutes.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._recent: dict[tuple[str, str], _Recent] = {}

    def admits(self, kind: str, source: str, message: str) -> bool:
        """Whether an event is logged now; otherwise the next summary counts it."""
        now = self._clock.monotonic()
        key = (kind.partition(".")[0], source)
        recent = self._recent.get(key)
        if recent is None or (now - recent.begin >= WINDOW and recent.held == 0):
            # A minute passed without anything held back: events are logged one by one again.
            recent = self._recent[key] = _Recent(now)
        if recent.told < MOST:
            recent.told += 1
            return True
        recent.held += 1
        recent.last_at, recent.last_kind, recent.last_message = now, kind, message
        return False

    def summaries(self, *, at_the_end: bool = False) -> Iterator[Summary]:
        """Yield what was held back for a minute, or, at the end, at all; each is yielded once."""
        now = self._clock.monotonic()
        for (family, source), recent in list(self._recent.items()):
            passed = now - recent.begin
            if passed < WINDOW and not at_the_end:
                continue
            if recent.held == 0:
                del self._recent[family, source]
                continue
            yield Summary(
                f"{family}.flapping",
                source,
                f"{recent.held} more events in {passed:.0f} s, the last one "
                f"{recent.last_kind}: {recent.last_message}",
            )
            if now - recent.last_at < WINDOW:
                self._recent[family, source] = _Recent(now, MOST)
            else:
                del self._recent[family, source]
