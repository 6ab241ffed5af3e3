"""The state of the work on each loop: open, planned, done, verified, with owner and note.

Rows are appended like everything in the historian: the newest of a loop counts, the others are its
record.
"""

from __future__ import annotations

import time

from sqlalchemy import insert
from sqlalchemy.exc import SQLAlchemyError

from fieldlink.store.database import cause_of, open_for_reading, open_for_writing, shown
from fieldlink.store.errors import StoreError
from fieldlink.store.records import EventRecord, WorkRecord

__all__ = ["REPAIR_KINDS", "WORK_DONE", "WORK_STATES", "record_work"]

WORK_STATES = ("open", "planned", "done", "verified")
"""In the order in which work goes through them."""

WORK_DONE = "work.done"
"""Kind of the event that marks a repair: the figures after it are compared with those before."""

REPAIR_KINDS = (WORK_DONE, "operator.annotate")
"""Events that say that a valve was repaired; their source is the loop."""


def record_work(
    url: str,
    loop: str,
    state: str,
    *,
    owner: str = "",
    note: str = "",
    author: str = "",
    utc_ms: int | None = None,
) -> WorkRecord:
    """Store the state of the work on a loop, and the event that says so.

    A daemon may write to the same historian meanwhile.

    Args:
        url: the historian.
        loop: the loop's name.
        state: one of `WORK_STATES`.
        owner, note, author: who does it, what there is to say, who says it.
        utc_ms: when it happened; now unless given.

    Raises:
        StoreError: unknown state, there is no historian, or it cannot be written.
    """
    if state not in WORK_STATES:
        raise StoreError(f"the state {state!r} is not known; use one of: {', '.join(WORK_STATES)}")
    moment = round(1000.0 * time.time()) if utc_ms is None else utc_ms
    record = WorkRecord(loop, moment, state, owner, note, author)
    words = f"{state}, owner {owner or 'nobody'}" + (f": {note}" if note else "")
    event = EventRecord(moment, f"work.{state}", loop, words, {"author": author})
    # Work is entered for loops that the historian knows; a mistyped address makes no new one.
    open_for_reading(url).dispose()
    engine = open_for_writing(url, record)
    try:
        with engine.begin() as connection:
            connection.execute(insert(event.table), event.row())
    except SQLAlchemyError as error:
        raise StoreError(
            f"the historian {shown(url)} has the new state and not its event: "
            f"{cause_of(error)}; give the command again"
        ) from error
    finally:
        engine.dispose()
    return record
