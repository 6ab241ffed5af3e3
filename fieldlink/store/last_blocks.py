"""The last block of every loop, and the newest ones of a loop."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Select, func, select

from fieldlink.store.reading import reading
from fieldlink.store.records import WritebackRecord
from fieldlink.store.schema import WRITEBACKS

__all__ = ["last_blocks", "newest_blocks"]


def last_blocks(url: str) -> dict[str, WritebackRecord]:
    """Return, by loop, the last row with a sequence number.

    Raises:
        StoreError: the historian cannot be read.
    """
    c = WRITEBACKS.c
    last = select(func.max(c.id)).where(c.seq.is_not(None)).group_by(c.loop)
    query = select(WRITEBACKS).where(c.id.in_(last))
    return {row.loop: row for row in _read(url, query)}


def newest_blocks(url: str, loop: str, most: int = 200) -> tuple[WritebackRecord, ...]:
    """Return a loop's rows with a sequence number, newest first, at most ``most``.

    Raises:
        StoreError: the historian cannot be read.
    """
    c = WRITEBACKS.c
    query = select(WRITEBACKS).where(c.seq.is_not(None), c.loop == loop)
    return _read(url, query.order_by(c.id.desc()).limit(most))


def _read(url: str, query: Select[Any]) -> tuple[WritebackRecord, ...]:
    with reading(url) as connection:
        rows = [dict(row) for row in connection.execute(query).mappings()]
    for row in rows:
        del row["id"]
    return tuple(WritebackRecord(**row) for row in rows)
