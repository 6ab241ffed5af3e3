"""The findings of a historian, each as its newest row says."""

from __future__ import annotations

from sqlalchemy import Select, func, inspect, select

from fieldlink.store.reading import reading
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
    with reading(url) as connection:
        if not inspect(connection).has_table(FINDINGS.name):
            # a store of an earlier release that no daemon has opened since
            return ()
        rows = [dict(row) for row in connection.execute(query).mappings()]
    for row in rows:
        del row["id"]
        row["loops"] = tuple(row["loops"])
    return tuple(FindingRecord(**row) for row in rows)
