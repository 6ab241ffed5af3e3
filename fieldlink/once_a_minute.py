"""Messages that would repeat all the time: each is logged once a minute, with its count."""

from __future__ import annotations

import time
from collections.abc import Hashable

__all__ = ["OnceAMinute"]

TELL_EVERY = 60.0
"""Seconds between two messages of the same kind."""

MOST_KINDS = 100
"""Kinds that are remembered; strangers can make up any number of them."""


class OnceAMinute:
    """Limits the messages of a kind to one a minute."""

    def __init__(self) -> None:
        self._told: dict[Hashable, tuple[float, int]] = {}

    def note(self, kind: Hashable, number: int = 1) -> int:
        """Count ``number`` messages of a kind.

        Returns:
            How many to report: all since the last time, or 0 when that was less than a minute ago.
        """
        now = time.monotonic()
        if kind not in self._told and len(self._told) >= MOST_KINDS:
            self._told.clear()
        before, held = self._told.get(kind, (None, 0))
        if before is not None and now - before < TELL_EVERY:
            self._told[kind] = before, held + number
            return 0
        self._told[kind] = now, 0
        return held + number
