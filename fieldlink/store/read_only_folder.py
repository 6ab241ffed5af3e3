"""Reading a historian in a folder that cannot be written: a mounted copy, an archive, a full disk.

SQLite keeps two files beside a database with a write-ahead log, and makes them to read it. Where it
cannot, and the log holds nothing, the file alone is the whole historian and is read as it is.
"""

from __future__ import annotations

import os
from pathlib import Path
from shutil import disk_usage

from fieldlink.store.errors import StoreError

__all__ = ["is_read_alone", "refuse_hidden_rows"]

_VERSIONS = slice(18, 20)
"""Bytes of the file's head that say how it is written and read; 2 is a write-ahead log."""

_INDEX_BYTES = 32768
"""The least size of a log's index (https://sqlite.org/walformat.html, section 1.4)."""


def is_read_alone(file: Path) -> bool:
    """Whether a file must be, and can be, read without those beside it (``immutable=1``)."""
    return _lacks_index(file) and not _log_of(file)


def refuse_hidden_rows(file: Path) -> None:
    """Refuse a file whose newest rows are in a log that cannot be opened.

    Raises:
        StoreError: the log has rows, and the folder may not be written.
    """
    if _lacks_index(file) and (rows := _log_of(file)):
        raise StoreError(
            f"the historian {file} cannot be read: its newest rows are in {file.name}-wal ({rows} "
            f"bytes), and SQLite has to write to {file.parent} to read them, which is "
            f"{'full' if _may_be_written(file.parent) else 'read-only'}; "
            "copy both files to another folder, or read it where the daemon runs"
        )


def _lacks_index(file: Path) -> bool:
    """Whether the log's index has to be made and cannot be; a daemon at work has made it."""
    index = file.with_name(f"{file.name}-shm")
    try:
        # A shorter one is what a full disk has left of an attempt to make it.
        if index.exists() and index.stat().st_size >= _INDEX_BYTES:
            return False
        if _may_be_written(file.parent) and disk_usage(file.parent).free >= _INDEX_BYTES:
            return False
        with file.open("rb") as stream:
            return stream.read(_VERSIONS.stop)[_VERSIONS] == b"\2\2"
    except OSError:
        # The reader says why it cannot be opened.
        return False


def _may_be_written(folder: Path) -> bool:
    return os.access(folder, os.W_OK)


def _log_of(file: Path) -> int:
    """Bytes in the write-ahead log."""
    log = file.with_name(f"{file.name}-wal")
    return log.stat().st_size if log.exists() else 0
