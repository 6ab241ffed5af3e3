"""What belongs to one data directory: one daemon at a time, and its identity as a writer."""

from __future__ import annotations

import fcntl
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fieldlink.errors import FieldlinkError
from fieldlink.file_at import why_closed
from fieldlink.store import StoreError

__all__ = ["InUseError", "is_in_use", "only_daemon", "writer_identity"]

LOCK, IDENTITY = "daemon.lock", "writer-id"
FOLDER_MODE, FILE_MODE = 0o750, 0o640


class InUseError(FieldlinkError):
    """Another daemon has the data directory."""


@contextmanager
def only_daemon(data_dir: Path) -> Iterator[int]:
    """Hold the data directory while the block runs; gives this installation's identity.

    The lock ends with the process, however that ends.

    Raises:
        InUseError: another process holds it.
        StoreError: the data directory cannot be written.
    """
    try:
        data_dir.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
        lock = os.open(data_dir / LOCK, os.O_CREAT | os.O_RDWR, FILE_MODE)
    except OSError as error:
        if why := why_closed(data_dir / LOCK):
            raise StoreError(why) from error
        raise StoreError(
            f"the data directory {data_dir} cannot be written: {error.strerror}; "
            "set data_dir to a folder that this user may write"
        ) from error
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            holder = os.pread(lock, 20, 0).decode("ascii", "replace").strip() or "unknown"
            raise InUseError(
                f"the data directory {data_dir} is in use by process {holder}; stop that daemon, "
                "or give this site a data_dir of its own"
            ) from error
        # The number is for the message above only: a full disk does not keep a daemon from running.
        with suppress(OSError):
            os.ftruncate(lock, 0)
            os.pwrite(lock, f"{os.getpid()}\n".encode(), 0)
        yield writer_identity(data_dir)
    finally:
        os.close(lock)


def is_in_use(data_dir: Path) -> bool:
    """Whether a daemon holds the data directory now."""
    try:
        lock = os.open(data_dir / LOCK, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(lock)
    return False


def writer_identity(data_dir: Path) -> int:
    """Return the installation's identity, 1 to 65535; it is drawn once and kept.

    Raises:
        StoreError: it can be neither read nor written.
    """
    file = data_dir / IDENTITY
    try:
        known = file.read_text("ascii").strip() if file.exists() else ""
        if known.isdecimal() and 1 <= int(known) <= 0xFFFF:
            return int(known)
        identity = 1 + secrets.randbelow(0xFFFF)
        part = file.with_suffix(".new")
        part.write_text(f"{identity}\n", "ascii")
        part.chmod(FILE_MODE)
        part.replace(file)
    except (OSError, UnicodeDecodeError) as error:
        if why := why_closed(file):
            raise StoreError(why) from error
        raise StoreError(
            f"the file {file} cannot be used: {getattr(error, 'strerror', 'it is not text')}; it "
            "holds this installation's identity, and may be deleted while no daemon runs; see to "
            "free space"
        ) from error
    return identity
