"""Whether the file of an SQLite historian is still the one that was opened.

A program that has a file open does not notice that the file was deleted, moved away or replaced: it
writes on into a file without a name. So the identity of the file behind its name is looked at.
"""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import Engine
from sqlalchemy.exc import SQLAlchemyError

from fieldlink.store.errors import StoreError

__all__ = ["Presence"]

_COMPANIONS = ("-wal", "-shm")

Identity = tuple[int, int]


class Presence:
    """Remembers what a file was when it was opened for writing.

    Args:
        file: the database, which is there.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._known = _identity(file)
        self._companions = {
            path: _identity(path) for path in (file.with_name(file.name + c) for c in _COMPANIONS)
        }

        self._let_go = False

    def lost(self) -> str:
        """Say what happened to the file; empty while it is the one that was opened."""
        now = _identity(self._file)
        if now == self._known:
            return ""
        return "was deleted or moved away" if now is None else "was replaced by another file"

    def let_go(self, engine: Engine) -> None:
        """Complete the file that is gone, wherever it is, and clear away what it left here.

        Rows that wait in its journal go into the file itself; the journal under the old name must
        not be taken for that of the file which comes next.

        Raises:
            StoreError: it cannot be cleared away.
        """
        if self._let_go:
            return
        self._let_go = True
        emptied = _empty_journal(engine)
        engine.dispose()
        try:
            for path, known in self._companions.items():
                if known is None or _identity(path) != known:
                    continue
                if emptied:
                    path.unlink()
                else:
                    # It may be all that is left: it stays, under a name that no database has.
                    path.rename(path.with_name(f"{path.name}.left-{known[1]}"))
        except OSError as error:
            raise StoreError(
                f"{self._file} {self.lost()}, and what it left beside it cannot be cleared away: "
                f"{error.strerror}"
            ) from error


def _empty_journal(engine: Engine) -> bool:
    try:
        with engine.connect() as connection:
            busy = connection.exec_driver_sql("PRAGMA wal_checkpoint(TRUNCATE)").scalar_one()
    except SQLAlchemyError:
        return False
    return not busy


def _identity(path: Path) -> Identity | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino
