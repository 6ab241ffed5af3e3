"""Opening the historian's database, for writing and for reading."""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import Engine, create_engine, event, insert, select
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, NoSuchModuleError, SQLAlchemyError

from fieldlink.store.errors import StoreError
from fieldlink.store.records import EventRecord
from fieldlink.store.schema import META, METADATA, SCHEMA_VERSION

__all__ = ["open_for_reading", "open_for_writing"]


def open_for_writing(url: str, opened: EventRecord, busy_timeout: float = 5.0) -> Engine:
    """Create what is missing, store the event ``opened``, and return the engine.

    The event is the proof that the database can be written; a daemon that finds out later has
    samples that it cannot keep.

    Raises:
        StoreError: the address is wrong, the folder or file cannot be written, the file is no
            database, or it was made by another release.
    """
    address = _address(url)
    file = _file_of(address)
    if file is not None:
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(
                f"the data directory {file.parent} cannot be made: {error.strerror}; "
                "make it, or set data_dir to a folder that this user may write"
            ) from error
    engine = _engine(address, busy_timeout)
    try:
        METADATA.create_all(engine)
        with engine.begin() as connection:
            version = connection.scalar(select(META.c.value).where(META.c.key == "schema"))
            if version is None:
                connection.execute(insert(META), {"key": "schema", "value": str(SCHEMA_VERSION)})
            elif version != str(SCHEMA_VERSION):
                raise StoreError(
                    f"{_shown(address)} has schema {version}, this release writes schema "
                    f"{SCHEMA_VERSION}; move it away or set historian.url to a new file"
                )
            connection.execute(insert(opened.table), opened.row())
    except SQLAlchemyError as error:
        engine.dispose()
        raise StoreError(
            f"the historian {_shown(address)} cannot be written: {_cause(error)}; check the "
            "folder's permissions, the free space, and that no other program holds the file"
        ) from error
    except BaseException:
        engine.dispose()
        raise
    return engine


def open_for_reading(url: str) -> Engine:
    """Return an engine on a historian that exists.

    Raises:
        StoreError: there is no such file, or the address is wrong.
    """
    address = _address(url)
    file = _file_of(address)
    if file is not None and not file.is_file():
        raise StoreError(
            f"there is no historian at {file}; run the daemon first, or check data_dir"
        )
    return _engine(address, busy_timeout=5.0)


def _address(url: str) -> URL:
    try:
        return make_url(url)
    except ArgumentError as error:
        raise StoreError(
            f"historian.url = {url!r} is no database address; write sqlite:///history.sqlite"
        ) from error


def _file_of(address: URL) -> Path | None:
    in_memory = address.database in (None, "", ":memory:")
    if address.get_backend_name() != "sqlite" or in_memory:
        return None
    return Path(str(address.database))


def _shown(address: URL) -> str:
    return address.render_as_string(hide_password=True)


def _cause(error: SQLAlchemyError) -> str:
    return str(getattr(error, "orig", None) or error)


def _engine(address: URL, busy_timeout: float) -> Engine:
    sqlite = address.get_backend_name() == "sqlite"
    try:
        engine = create_engine(address, connect_args={"timeout": busy_timeout} if sqlite else {})
    except (NoSuchModuleError, ImportError) as error:
        raise StoreError(
            f"no driver for {_shown(address)}: {error}; install it, or use sqlite:///history.sqlite"
        ) from error
    if sqlite:
        event.listen(engine, "connect", _configure_sqlite)
    return engine


def _configure_sqlite(connection: object, _record: object) -> None:
    cursor = connection.cursor()  # type: ignore[attr-defined]
    # WAL: readers never wait for the writer. NORMAL: a killed process loses nothing, a power cut at
    # most the last transactions, and no commit waits for the disk.
    cursor.execute("PRAGMA journal_mode=WAL")
    cursor.execute("PRAGMA synchronous=NORMAL")
    cursor.close()
