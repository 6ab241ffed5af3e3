"""The last event of every source, by kind."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import func, select

from fieldlink.store.reading import reading
from fieldlink.store.records import EventRecord
from fieldlink.store.schema import EVENTS

__all__ = ["last_events"]


def last_events(url: str, kinds: Sequence[str]) -> tuple[EventRecord, ...]:
    """Return the last event of each of these kinds and each source, oldest first.

    Raises:
        StoreError: the historian cannot be read.
    """
    c = EVENTS.c
    last = select(func.max(c.id)).where(c.kind.in_(kinds)).group_by(c.kind, c.source)
    query = select(EVENTS).where(c.id.in_(last)).order_by(c.id)
    with reading(url) as connection:
        rows = [dict(row) for row in connection.execute(query).mappings()]
    for row in rows:
        del row["id"]
    return tuple(EventRecord(**row) for row in rows)
