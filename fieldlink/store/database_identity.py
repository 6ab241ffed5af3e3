"""Whether a database is a historian, found out before anything in it is changed."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

from sqlalchemy import Engine, inspect, select

from fieldlink.store.errors import StoreMismatchError
from fieldlink.store.read_only_folder import is_read_alone
from fieldlink.store.schema import META, METADATA, SCHEMA_VERSION

__all__ = ["refuse_foreign_file", "refuse_foreign_tables", "refuse_unreadable_file"]

OLDEST_READABLE = 2
"""Schema whose tables can be read as they are: what came later are tables of their own."""

_OF_LATER_RELEASES = {"samples": {"late_ms", "clock_steps"}}
"""Columns that a historian of the first release lacks."""

NAMED = 5
"""Tables of another program that a message names."""

Tables = Mapping[str, set[str]]
"""The names of the columns of each table."""


def refuse_foreign_file(file: Path) -> None:
    """Refuse an SQLite file of another program or of a later release, without writing to it.

    What cannot be read as a database is not judged here: opening it will tell.

    Raises:
        StoreMismatchError: its tables are not those of a historian that this release writes.
    """
    if (found := _look_into(file)) is not None:
        _judge(str(file), *found)


def refuse_unreadable_file(file: Path) -> None:
    """Refuse to read the historian of a later release, or one whose columns are too old.

    Any other database passes: what can be read of it is for the reader to say.

    Raises:
        StoreMismatchError: its schema is one that this release does not read.
    """
    if (found := _look_into(file)) is None:
        return
    tables, version = found
    if version is None or not version.isdecimal() or not {"samples", "writebacks"} <= set(tables):
        return
    if int(version) > SCHEMA_VERSION:
        raise StoreMismatchError(_of_a_later_release(str(file), version))
    if int(version) < OLDEST_READABLE:
        raise StoreMismatchError(
            f"{file} has schema {version} of the first release, this release reads schema "
            f"{OLDEST_READABLE} to {SCHEMA_VERSION}; start the daemon on it once (fieldlink run), "
            "which keeps its data and adds what is missing"
        )


def _look_into(file: Path) -> tuple[Tables, str | None] | None:
    """Return the tables of an SQLite file and its schema; None when it holds no database."""
    if not os.path.isfile(file) or file.stat().st_size == 0:
        return None
    try:
        alone = "&immutable=1" if is_read_alone(file) else ""
        address = f"{file.absolute().as_uri()}?mode=ro{alone}"
        with closing(sqlite3.connect(address, uri=True)) as found:
            names = found.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
            tables = {
                name: {
                    column
                    for (column,) in found.execute("SELECT name FROM pragma_table_info(?)", [name])
                }
                for (name,) in names
                if not name.startswith("sqlite_")
            }
            version = None
            if _has_meta(tables):
                row = found.execute("SELECT value FROM meta WHERE key = 'schema'").fetchone()
                version = None if row is None else str(row[0])
    except sqlite3.Error:
        return None
    return tables, version


def refuse_foreign_tables(engine: Engine) -> None:
    """Refuse a database on a server; see `refuse_foreign_file`.

    Raises:
        StoreMismatchError: its tables are not those of a historian that this release writes.
        SQLAlchemyError: it cannot be read.
    """
    look = inspect(engine)
    tables = {
        name: {column["name"] for column in look.get_columns(name)}
        for name in look.get_table_names()
    }
    version = None
    if _has_meta(tables):
        with engine.connect() as connection:
            version = connection.scalar(select(META.c.value).where(META.c.key == "schema"))
    _judge(engine.url.render_as_string(), tables, version)


def _has_meta(tables: Tables) -> bool:
    return {"key", "value"} <= tables.get(META.name, set())


def _judge(where: str, tables: Tables, version: str | None) -> None:
    if version is not None:
        if version.isdecimal() and 1 <= int(version) <= SCHEMA_VERSION:
            # Tables of another program beside ours are its own affair.
            return
        if version.isdecimal() and int(version) > SCHEMA_VERSION:
            raise StoreMismatchError(_of_a_later_release(where, version))
        raise StoreMismatchError(
            f"{where} has schema {version}, this release writes schema {SCHEMA_VERSION}; move it "
            "away or set historian.url to a new one"
        )
    foreign = sorted(name for name, columns in tables.items() if not _is_ours(name, columns))
    if foreign:
        named = ", ".join(foreign[:NAMED]) + (", ..." if len(foreign) > NAMED else "")
        raise StoreMismatchError(
            f"{where} is the database of another program (tables {named}), nothing was written to "
            "it; set historian.url to a database of its own"
        )


def _of_a_later_release(where: str, version: str) -> str:
    return (
        f"{where} has schema {version} of a later release, this release knows schema "
        f"{SCHEMA_VERSION}; install the later release again, or set historian.url to a new file"
    )


def _is_ours(name: str, columns: set[str]) -> bool:
    table = METADATA.tables.get(name)
    if table is None:
        return False
    needed = {column.name for column in table.columns} - _OF_LATER_RELEASES.get(name, set())
    return needed <= columns
