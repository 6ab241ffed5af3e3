"""Which row of each loop is its newest: parts of queries that visit one row a loop.

One step of an index leads from a loop to the next, and one more to the loop's newest row. A query a
loop would be slower by far: its cost is the one of building and sending it.
"""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import CTE, ColumnElement, ScalarSelect, Subquery, Table, func, select

from fieldlink.store.fleet_reader import SAME_BAND
from fieldlink.store.schema import ESTIMATES, WRITEBACKS

__all__ = ["ids_behind_blocks", "newest_ids", "stored_loops"]


def stored_loops(table: Table) -> CTE:
    """Return the names of a table's loops, with one empty name at the end.

    One step of the index for each name; DISTINCT would visit every row.
    """
    first = select(func.min(table.c.loop).label("loop")).cte("stored_loops", recursive=True)
    other = table.alias()
    after = select(func.min(other.c.loop)).where(other.c.loop > first.c.loop).scalar_subquery()
    return first.union_all(select(after).where(first.c.loop.is_not(None)))


def newest_ids(table: Table, loops: Sequence[str], *conditions: ColumnElement[bool]) -> Subquery:
    """Return the row number of the newest row of each loop that fulfils conditions."""
    if len(loops) == 1:
        newest = _newest_id(table, table.c.loop == loops[0], *conditions)
        return select(newest.label("id")).subquery()
    stored = stored_loops(table)
    newest = _newest_id(table, table.c.loop == stored.c.loop, *conditions)
    return select(newest.label("id")).select_from(stored).subquery()


def _newest_id(table: Table, *conditions: ColumnElement[bool]) -> ScalarSelect[int]:
    """Return the row number of the newest row that fulfils conditions on one loop."""
    order = (table.c.utc_ms.desc(), table.c.id.desc())
    query = select(table.c.id).where(*conditions).order_by(*order).limit(1)
    return query.correlate_except(table).scalar_subquery()


def ids_behind_blocks(accepted: Subquery) -> Subquery:
    """Return the row numbers of the estimates whose model the PLC uses.

    A block that is renewed keeps its stick band, however long ago the estimate was made.

    Args:
        accepted: row numbers of the blocks that the PLC acknowledged.
    """
    blocks, c = WRITEBACKS.alias("blocks"), ESTIMATES.c
    S = blocks.c.stick_band
    # The highest row number, not the newest time: SQLite then searches by stick band and does not
    # read through the loop's windows.
    behind = (
        select(func.max(c.id))
        .where(
            c.loop == blocks.c.loop,
            c.verdict == "stiction",
            c.stick_band.between(S * (1.0 - SAME_BAND), S * (1.0 + SAME_BAND)),
        )
        .correlate(blocks)
        .scalar_subquery()
    )
    return (
        select(behind.label("id"))
        .select_from(blocks)
        .join(accepted, blocks.c.id == accepted.c.id)
        .where(blocks.c.status == "valid")
        .subquery()
    )
