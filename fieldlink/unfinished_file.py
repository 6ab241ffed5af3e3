"""Files that appear whole or not at all, and what is left of one when writing fails.

write_whole(Path("FC101.png"), picture)  # the file before stays if the disk is full
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

__all__ = ["created", "remove_unfinished", "write_whole"]


def remove_unfinished(file: Path) -> None:
    """Remove a file that is not finished, if it is there.

    Where the file system cannot do that either (it is read-only), the error that ended the writing
    is the one to report, and the rest of the file stays.
    """
    with suppress(OSError):
        file.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes, *, mode: int | None = None) -> None:
    """Write a file beside its final name, then put it there: a reader sees the whole one.

    A link leads to the file that is written. What is no file, such as /dev/stdout or a pipe, is
    written to and stays what it is.

    Args:
        path: the file; one that is there is replaced.
        content: all of it.
        mode: permissions of the file; unless given, those of the file before, or the usual ones
            of a new file.

    Raises:
        OSError: it cannot be written; what was there before is unchanged.
    """
    target = Path(os.path.realpath(path))
    before = target.stat() if target.exists() else None
    if before is not None and not target.is_file():
        target.write_bytes(content)
        return
    if before is not None and not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    # Of a long name a part, as a name has at most 255 bytes.
    part = target.with_name(f".{target.name[:40]}.{os.getpid()}.part")
    try:
        with part.open("wb") as stream:
            if before is not None:
                os.fchmod(stream.fileno(), stat.S_IMODE(before.st_mode))
                # Root may write a file that a service's account reads.
                with suppress(PermissionError):
                    os.fchown(stream.fileno(), before.st_uid, before.st_gid)
            if mode is not None:
                os.fchmod(stream.fileno(), mode)
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(target)
    except BaseException:
        remove_unfinished(part)
        raise


@contextmanager
def created(file: Path) -> Iterator[TextIO]:
    """Open a new text file (UTF-8); nothing is left of it when writing fails.

    Raises:
        FileExistsError: the file is there already; it stays as it is.
        OSError: it cannot be written.
    """
    stream = file.open("x", encoding="utf-8")
    try:
        with stream:
            yield stream
    except BaseException:
        remove_unfinished(file)
        raise
