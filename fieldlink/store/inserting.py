"""Putting records into tables, and what a failure to do so means."""

from __future__ import annotations

import sqlite3
from collections import defaultdict
from collections.abc import Sequence

from sqlalchemy import Engine, insert
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError, SQLAlchemyError

from fieldlink.store.damage import is_corruption
from fieldlink.store.postgresql import is_refusal_of_the_server
from fieldlink.store.records import Record
from fieldlink.store.writers import Claim

__all__ = ["insert_batch", "may_pass"]


def insert_batch(engine: Engine, batch: Sequence[Record], claim: Claim | None = None) -> int:
    """Insert all of ``batch`` in one transaction and return how many records that were.

    Raises:
        StoreInUseError: another writer has taken the claim over; nothing is inserted.
    """
    by_table = defaultdict(list)
    for record in batch:
        by_table[record.table].append(record.row())
    with engine.begin() as connection:
        if claim is not None:
            claim.renew(connection)
        for table, rows in by_table.items():
            connection.execute(insert(table), rows)
    return len(batch)


def may_pass(error: SQLAlchemyError) -> bool:
    """Whether waiting may cure it: locked, full, unplugged, a server that is away or read-only.

    A table or column that is missing is an operational error of SQLite, too, and stays missing.
    """
    if getattr(getattr(error, "orig", None), "sqlite_errorcode", None) == sqlite3.SQLITE_ERROR:
        return False
    if isinstance(error, OperationalError | InterfaceError) or is_refusal_of_the_server(error):
        return True
    return is_corruption(error) or (isinstance(error, DBAPIError) and error.connection_invalidated)
