"""Events in the order in which they were stored: the newest ones, then those that are added.

A row's number tells what is new, not its time: the wall clock may have been set back meanwhile.
"""

from __future__ import annotations

from sqlalchemy import func, select

from fieldlink.store.reading import reading
from fieldlink.store.records import EventRecord
from fieldlink.store.schema import EVENTS

__all__ = ["EventStream"]


class EventStream:
    """Reads the events of the historian at ``url``, each once."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._seen = 0

    def begin(self, count: int) -> tuple[EventRecord, ...]:
        """Return at most ``count`` of the newest events, oldest first; `follow` goes on from there.

        Raises:
            StoreError: the historian cannot be read.
        """
        return self._read(count)

    def follow(self) -> tuple[EventRecord, ...]:
        """Return the events stored since the last call, oldest first.

        Raises:
            StoreError: the historian cannot be read.
        """
        return self._read(None)

    def _read(self, count: int | None) -> tuple[EventRecord, ...]:
        c = EVENTS.c
        with reading(self._url) as connection:
            newest = connection.scalar(select(func.max(c.id))) or 0
            if newest < self._seen:
                # Another file has taken the place of a damaged one, and counts from 1.
                self._seen = 0
            query = select(EVENTS).where(c.id > self._seen, c.id <= newest)
            rows = connection.execute(query.order_by(c.id.desc()).limit(count)).mappings().all()
        self._seen = newest
        return tuple(
            EventRecord(row["utc_ms"], row["kind"], row["source"], row["message"])
            for row in reversed(rows)
        )
