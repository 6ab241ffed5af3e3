"""A restored copy beside the write-ahead log of the file that it replaces.

SQLite takes the log beside a file for that file's own and writes its pages into it: a copy put in
place of a historian whose daemon was killed comes out damaged, or as new as what it replaced. A
historian says of itself that it has a log; a finished copy (`fieldlink.store.backup`) says that it
has none, so a log beside one is of another file.
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from fieldlink.store.errors import StoreError

__all__ = ["refuse_foreign_log", "remember_as_open", "set_foreign_log_aside"]

_VERSIONS = slice(18, 20)
"""Bytes of the file's head that say how it is written and read (https://sqlite.org/fileformat2.html,
section 1.3.3)."""

_WITHOUT_LOG = b"\1\1"

_own_log: set[tuple[int, int]] = set()
"""Files of this process that have a log of their own, by device and inode. They are looked into
before SQLite opens them and never again: to close a file gives up the locks that SQLite holds on it
in this process (https://sqlite.org/howtocorrupt.html, section 2.2)."""


def refuse_foreign_log(file: Path) -> None:
    """Refuse to read a copy beside another file's log: reading would spoil it.

    Raises:
        StoreError: it is one.
    """
    if _has_foreign_log(file):
        raise StoreError(
            f"{file} is a copy, and {file.name}-wal beside it is of the file that it replaced; "
            f"remove {file.name}-wal and {file.name}-shm, or start the daemon, which sets them "
            "aside"
        )


def set_foreign_log_aside(file: Path) -> str:
    """Rename a log that is not the file's own; return what was done, empty where there is none.

    Raises:
        StoreError: it cannot be renamed.
    """
    if not _has_foreign_log(file):
        return ""
    log, index = (file.with_name(f"{file.name}-{part}") for part in ("wal", "shm"))
    # A name that SQLite takes for no file's log.
    aside = log.with_name(f"{log.name}.left-{datetime.now(UTC):%Y%m%dT%H%M%SZ}")
    try:
        index.unlink(missing_ok=True)
        log.rename(aside)
    except OSError as error:
        raise StoreError(
            f"{log} is of the file that {file.name} has replaced, and cannot be renamed: "
            f"{error.strerror}; remove it by hand"
        ) from error
    return (
        f"{log.name} was of the file that {file.name} has replaced; it is kept as {aside.name}, "
        "and the historian goes on from the copy"
    )


def remember_as_open(file: Path) -> None:
    """Look into a file no more: SQLite has it open in this process, with a log of its own."""
    _own_log.add(_identity(file))


def _has_foreign_log(file: Path) -> bool:
    log = file.with_name(f"{file.name}-wal")
    try:
        identity = _identity(file)
        if identity in _own_log:
            return False
        foreign = False
        if log.exists() and log.stat().st_size:
            with file.open("rb") as stream:
                foreign = stream.read(_VERSIONS.stop)[_VERSIONS] == _WITHOUT_LOG
    except OSError:
        # Who opens the file says what is wrong with it.
        return False
    if not foreign:
        _own_log.add(identity)
    return foreign


def _identity(file: Path) -> tuple[int, int]:
    found = file.stat()
    return found.st_dev, found.st_ino
