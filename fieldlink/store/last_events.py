"""The last event of every source, by kind."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import func, select
from sqlalchemy.exc import SQLAlchemyError

from fieldlink.store.database import cause_of, open_for_reading, reading_advice, shown
from fieldlink.store.errors import StoreError
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
    engine = open_for_reading(url)
    try:
        with engine.connect() as connection:
            rows = [dict(row) for row in connection.execute(query).mappings()]
    except SQLAlchemyError as error:
        raise StoreError(
            f"the events in {shown(url)} cannot be read: {cause_of(error)}; {reading_advice(error)}"
        ) from error
    finally:
        engine.dispose()
    for row in rows:
        del row["id"]
    return tuple(EventRecord(**row) for row in rows)
