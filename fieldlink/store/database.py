"""Opening the historian's database, for writing and for reading."""

from __future__ import annotations

import math
import os
from pathlib import Path

from sqlalchemy import Engine, create_engine, event, insert, select
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError, SQLAlchemyError

from fieldlink.file_at import why_closed, why_no_file
from fieldlink.store.damage import is_corruption, was_a_database
from fieldlink.store.database_identity import (
    refuse_foreign_file,
    refuse_foreign_tables,
    refuse_unreadable_file,
)
from fieldlink.store.errors import StoreAddressError, StoreCorruptError, StoreError
from fieldlink.store.foreign_log import refuse_foreign_log, remember_as_open
from fieldlink.store.postgresql import bound_lock_waits, connection_patience
from fieldlink.store.read_only_folder import is_read_alone, refuse_hidden_rows
from fieldlink.store.records import Record
from fieldlink.store.schema import META, METADATA, SCHEMA_VERSION, upgrade
from fieldlink.store.writers import Claim

__all__ = [
    "cause_of",
    "file_of",
    "is_away",
    "open_for_reading",
    "open_for_writing",
    "shown",
]

FOLDER_MODE = 0o750
FILE_MODE = 0o640
"""The owner writes, the group reads, nobody else does either; SQLite's companions follow."""

READERS_PATIENCE = 5.0
"""Seconds that a reader waits for another program's lock: longer than any commit of a daemon."""


_OF_A_FILE = (
    "the folder's permissions, the free space and inodes (df -h, df -i), and that no other program "
    "holds the file"
)
_OF_A_SERVER = (
    "that the server runs and takes this user's rows (not a read-only stand-by), the user's rights "
    "in the database, and the server's free space"
)


def open_for_writing(
    url: str, opened: Record, busy_timeout: float = 5.0, claim: Claim | None = None
) -> Engine:
    """Create what is missing, store the record ``opened``, and return the engine.

    The record is the proof that the database can be written; a daemon that finds out later has
    samples that it cannot keep.

    Raises:
        StoreInUseError: another writer has a loop of ``claim``.
        StoreCorruptError: the file was a historian and is damaged.
        StoreMismatchError: the database is another program's, or was made by another release.
        StoreAddressError: the address is wrong, or there is no driver for it.
        StoreError: the folder, the file or the server cannot be written now, or the file is no
            database.
    """
    address = _address(url)
    file = file_of(url)
    if file is not None:
        refuse_foreign_file(file)
        _make_file(file)
    engine = _engine(address, busy_timeout, writes=True)
    try:
        _prepare(engine, opened, claim)
    except SQLAlchemyError as error:
        engine.dispose()
        if file is not None and is_corruption(error) and was_a_database(file):
            raise StoreCorruptError(
                f"the historian {shown(url)} is damaged: {cause_of(error)}; "
                "it has to be set aside, sqlite3's .recover may save what is in it"
            ) from error
        if file is not None and is_corruption(error):
            raise StoreError(
                f"the historian {shown(url)} cannot be used: {cause_of(error)}; move {file.name} "
                "away, for a new one to be made, or restore a backup in its place"
            ) from error
        if file is not None and (why := why_closed(file)):
            raise StoreError(f"the historian cannot be written: {why}") from error
        where = _OF_A_SERVER if file is None else _OF_A_FILE
        raise StoreError(
            f"the historian {shown(url)} cannot be written: {cause_of(error)}; check {where}"
        ) from error
    except BaseException:
        engine.dispose()
        raise
    if address.get_backend_name() == "postgresql":
        bound_lock_waits(engine, busy_timeout)
    if file is not None:
        remember_as_open(file)
    return engine


def open_for_reading(url: str) -> Engine:
    """Return an engine on a historian that exists.

    Raises:
        StoreMismatchError: it was made by a release whose tables this one does not read.
        StoreError: there is no such file, its rows cannot all be read, or the address is wrong.
    """
    address = _address(url)
    file = file_of(url)
    if file is not None and (why := why_no_file(file) or _why_empty(file)):
        raise StoreError(
            f"there is no historian at {file} ({why}); run the daemon first, or check data_dir"
        )
    if file is not None:
        refuse_foreign_log(file)
        refuse_hidden_rows(file)
        refuse_unreadable_file(file)
        if is_read_alone(file):
            address = address.set(
                database=file.absolute().as_uri(), query={"immutable": "1", "uri": "true"}
            )
    return _engine(address, busy_timeout=READERS_PATIENCE)


def _why_empty(file: Path) -> str:
    """An empty file is no historian: SQLite would take it for a database without tables."""
    try:
        return "" if file.stat().st_size else "the file is empty"
    except OSError as error:
        return error.strerror or str(error)


def file_of(url: str) -> Path | None:
    """Return the file of an SQLite address; None in memory and for any other database."""
    address = _address(url)
    in_memory = address.database in (None, "", ":memory:")
    if address.get_backend_name() != "sqlite" or in_memory:
        return None
    return Path(str(address.database))


def shown(url: str) -> str:
    """Return the address as it may be shown: without its password."""
    return _address(url).render_as_string(hide_password=True)


def cause_of(error: SQLAlchemyError) -> str:
    """Return what the database itself said, in one line."""
    return " ".join(str(getattr(error, "orig", None) or error).split())


def is_away(engine: Engine, error: SQLAlchemyError) -> bool:
    """Whether the database server, not what was asked of it, is the trouble."""
    if engine.dialect.name == "sqlite":
        return False
    if isinstance(error, DBAPIError) and error.connection_invalidated:
        return True
    try:
        engine.connect().close()
    except SQLAlchemyError:
        return True
    return False


def _address(url: str) -> URL:
    try:
        address = make_url(url)
    except (ArgumentError, ValueError) as error:  # also for a port of letters
        # Not the text itself: a password may be in it.
        raise StoreAddressError(
            "historian.url is not a database address; write sqlite:///history.sqlite or "
            "postgresql://USER@HOST/DATABASE"
        ) from error
    if address.drivername == "postgresql":
        address = address.set(drivername="postgresql+psycopg")
    return address


def _make_file(file: Path) -> None:
    try:
        file.parent.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(
            f"the data directory {file.parent} cannot be made: {error.strerror}; "
            "make it, or set data_dir to a folder that this user may write"
        ) from error
    # Only what is not there is opened here: to close a file gives up all locks that SQLite holds
    # on it in this process, and another process would remove the log that is written here.
    try:
        os.close(os.open(file, os.O_CREAT | os.O_EXCL | os.O_RDWR, FILE_MODE))
    except FileExistsError:
        pass  # SQLite says whether it can be written
    except OSError as error:
        raise StoreError(
            f"the historian {file} cannot be written: {error.strerror}; check the folder's "
            "permissions and the free space"
        ) from error


def _prepare(engine: Engine, opened: Record, claim: Claim | None) -> None:
    if engine.dialect.name != "sqlite":
        refuse_foreign_tables(engine)
    METADATA.create_all(engine)
    with engine.begin() as connection:
        version = connection.scalar(select(META.c.value).where(META.c.key == "schema"))
        if version is None:
            connection.execute(insert(META), {"key": "schema", "value": str(SCHEMA_VERSION)})
        elif int(version) < SCHEMA_VERSION:
            upgrade(connection, int(version))
    with engine.begin() as connection:
        if claim is not None:
            claim.take(connection)
        connection.execute(insert(opened.table), opened.row())


def _engine(address: URL, busy_timeout: float, *, writes: bool = False) -> Engine:
    sqlite = address.get_backend_name() == "sqlite"
    patience: dict[str, float] = {}
    if sqlite:
        patience["timeout"] = busy_timeout
    elif address.get_backend_name() == "postgresql":
        patience = connection_patience(address, busy_timeout)
    try:
        engine = create_engine(address, connect_args=patience, pool_pre_ping=not sqlite)
    except (NoSuchModuleError, ImportError) as error:
        raise StoreAddressError(
            f"no driver for {address.render_as_string()}: {error}; install it (for PostgreSQL: "
            "pip install 'fieldlink[postgresql]'), or use sqlite:///history.sqlite"
        ) from error
    if sqlite and writes:
        # Who only reads changes nothing in a file that may be somebody else's.
        event.listen(engine, "connect", _configure_sqlite)
    return engine


def _configure_sqlite(connection: object, _record: object) -> None:
    # Not every SQLite is built with its mathematical functions.
    connection.create_function("sqrt", 1, _sqrt, deterministic=True)  # type: ignore[attr-defined]
    cursor = connection.cursor()  # type: ignore[attr-defined]
    # What retention frees can be given back to the file system; heeded by a new file only.
    cursor.execute("PRAGMA auto_vacuum=INCREMENTAL")
    # WAL: readers never wait for the writer. NORMAL: a killed process loses nothing, a power cut at
    # most the last transactions, and no commit waits for the disk.
    cursor.execute("PRAGMA journal_mode=WAL")
    cursor.execute("PRAGMA synchronous=NORMAL")
    cursor.execute("PRAGMA journal_size_limit=67108864")
    cursor.close()


def _sqrt(value: float | None) -> float | None:
    return None if value is None else math.sqrt(value)
