"""A copy of an SQLite historian while the daemon goes on writing: SQLite's online backup.

The copy is one moment of the historian, checked and only then given its name. PostgreSQL has its
own tools (pg_dump) and is refused here.
"""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from fieldlink.file_at import why_no_file
from fieldlink.store.database import FILE_MODE, file_of, shown
from fieldlink.store.errors import StoreError
from fieldlink.store.foreign_log import refuse_foreign_log
from fieldlink.store.read_only_folder import is_read_alone, refuse_hidden_rows
from fieldlink.unfinished_file import remove_unfinished

__all__ = ["Backup", "back_up"]

PATIENCE = 30.0
"""Seconds to wait for another program's lock."""


@dataclass(frozen=True, slots=True)
class Backup:
    """A finished copy: its file, bytes, and rows of samples."""

    file: Path
    bytes: int
    samples: int


def back_up(url: str, target: Path, *, overwrite: bool = False) -> Backup:
    """Copy the historian at ``url`` to the new file ``target``.

    Raises:
        StoreError: no SQLite historian, the target exists or cannot be written, or the copy is
            damaged because the historian is.
    """
    source = file_of(url)
    if source is None:
        raise StoreError(
            f"{shown(url)} is not an SQLite file; use the database's own tool, such as pg_dump"
        )
    if why := why_no_file(source):
        raise StoreError(f"there is no historian at {source} ({why}); check data_dir")
    if os.path.exists(target) and (not overwrite or target.samefile(source)):
        raise StoreError(f"{target} exists; name a new file, or replace it with --force")
    part = target.with_name(target.name + ".part")
    try:
        part.unlink(missing_ok=True)
        os.close(os.open(part, os.O_CREAT | os.O_EXCL | os.O_RDWR, FILE_MODE))
        samples = _copy(source, part)
        part.replace(target)
    except OSError as error:
        raise StoreError(
            f"{target} cannot be written: {error.strerror}; check the folder and the free space"
        ) from error
    except sqlite3.Error as error:
        advice = (
            "another program holds it: close that, or try again"
            if "locked" in str(error)
            else "check the free space, and with sqlite3's integrity_check whether the historian "
            "is damaged"
        )
        raise StoreError(f"{source} could not be copied to {target}: {error}; {advice}") from error
    finally:
        remove_unfinished(part)
    return Backup(target, target.stat().st_size, samples)


def _copy(source: Path, part: Path) -> int:
    refuse_foreign_log(source)
    refuse_hidden_rows(source)
    alone = "&immutable=1" if is_read_alone(source) else ""
    address = f"{source.absolute().as_uri()}?mode=ro{alone}"
    with (
        closing(sqlite3.connect(address, uri=True, timeout=PATIENCE)) as original,
        closing(sqlite3.connect(part)) as copy,
    ):
        # The copying itself waits for a lock without end; a read that is open by then needs none.
        original.execute("BEGIN")
        original.execute("SELECT count(*) FROM sqlite_master").fetchone()
        # All pages in one step: the daemon's writes in between would begin a stepwise copy again.
        original.backup(copy, pages=-1)
        # A copy that stands alone: no journal beside it that could be forgotten.
        copy.execute("PRAGMA journal_mode=DELETE")
        fault = copy.execute("PRAGMA quick_check(1)").fetchone()[0]
        if fault != "ok":
            raise sqlite3.DatabaseError(f"the copy is damaged: {fault}")
        return int(copy.execute("SELECT count(*) FROM samples").fetchone()[0])
