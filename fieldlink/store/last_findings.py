"""The findings of a historian, each as its newest row says."""

from __future__ import annotations

from sqlalchemy import Select, func, inspect, select
from sqlalchemy.exc import SQLAlchemyError

from fieldlink.store.database import cause_of, open_for_reading, reading_advice, shown
from fieldlink.store.errors import StoreError
from fieldlink.store.records import FindingRecord
from fieldlink.store.schema import FINDINGS

__all__ = ["CLOSED", "newest_of_findings", "open_findings"]

CLOSED = "closed"
"""The state of a finding that is over."""


def newest_of_findings() -> Select[tuple[object, ...]]:
    """Return the query for the newest row of each finding."""
    c = FINDINGS.c
    last = select(func.max(c.id)).group_by(c.finding)
    return select(FINDINGS).where(c.id.in_(last))


def open_findings(url: str) -> tuple[FindingRecord, ...]:
    """Return the newest row of every finding that is not closed, the oldest finding first.

    Raises:
        StoreError: the historian cannot be read.
    """
    c = FINDINGS.c
    query = newest_of_findings().where(c.state != CLOSED).order_by(c.born_ms, c.finding)
    engine = open_for_reading(url)
    try:
        if not inspect(engine).has_table(FINDINGS.name):
            # a store of an earlier release that no daemon has opened since
            return ()
        with engine.connect() as connection:
            rows = [dict(row) for row in connection.execute(query).mappings()]
    except SQLAlchemyError as error:
        raise StoreError(
            f"the findings in {shown(url)} cannot be read: {cause_of(error)}; "
            f"{reading_advice(error)}"
        ) from error
    finally:
        engine.dispose()
    for row in rows:
        del row["id"]
        row["loops"] = tuple(row["loops"])
    return tuple(FindingRecord(**row) for row in rows)
