"""A damaged SQLite file: how it is recognised, and how it is set aside."""

from __future__ import annotations

import sqlite3
from datetime import UTC, datetime
from pathlib import Path

from sqlalchemy.exc import SQLAlchemyError

from fieldlink.store.errors import StoreError

__all__ = ["is_corruption", "set_aside", "was_a_database"]

_CORRUPTION = frozenset({sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB})
_HEADER = b"SQLite format 3\0"
_COMPANIONS = ("", "-wal", "-shm")


def is_corruption(error: SQLAlchemyError | sqlite3.Error) -> bool:
    """Whether SQLite says that the file itself is damaged, not only out of reach for now."""
    code = getattr(getattr(error, "orig", error), "sqlite_errorcode", None)
    # The lowest byte of an extended result code is the code it extends.
    return code is not None and (code & 0xFF) in _CORRUPTION


def was_a_database(file: Path) -> bool:
    """Whether the file begins like an SQLite database, or with the zeros that a power cut leaves.

    Anything else is another program's file and must not be touched.
    """
    try:
        with file.open("rb") as stream:
            begin = stream.read(len(_HEADER))
    except OSError:
        return False
    return begin == _HEADER or (len(begin) > 0 and not any(begin))


def set_aside(file: Path) -> Path:
    """Rename a damaged database and what belongs to it; return its new name, which has the date.

    Raises:
        StoreError: it cannot be renamed.
    """
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    target = file.with_name(f"{file.stem}.damaged-{stamp}{file.suffix}")
    number = 1
    while target.exists():
        number += 1
        target = file.with_name(f"{file.stem}.damaged-{stamp}-{number}{file.suffix}")
    try:
        for companion in _COMPANIONS:
            part = file.with_name(file.name + companion)
            if part.exists():
                part.rename(target.with_name(target.name + companion))
    except OSError as error:
        raise StoreError(
            f"{file} is damaged and cannot be renamed to {target.name}: {error.strerror}; "
            "move it away by hand"
        ) from error
    return target
