"""Files that people name, read with a bound: a path may lead to a device, a pipe or an image."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

__all__ = ["UnreadableFileError", "read_bytes"]

MEGABYTE = 1_000_000


class UnreadableFileError(Exception):
    """A file that cannot be read: what was found, and what to do.

    Attributes:
        message, remedy: the two halves of a sentence.
    """

    def __init__(self, message: str, remedy: str) -> None:
        super().__init__(f"{message}; {remedy}")
        self.message = message
        self.remedy = remedy


def read_bytes(path: Path, *, most_megabytes: int, pipe: bool = False) -> bytes:
    """Return the content of a file.

    Args:
        path: the file.
        most_megabytes: what is larger is refused before it fills the memory.
        pipe: whether a pipe will do, such as a shell's ``<(zcat FC101.csv.gz)``.

    Raises:
        UnreadableFileError: it cannot be read, is not a file, or is too large.
    """
    try:
        kind = path.stat().st_mode
        if not (stat.S_ISREG(kind) or (pipe and stat.S_ISFIFO(kind))):
            what = "a folder" if stat.S_ISDIR(kind) else "a device, a socket or a pipe"
            raise UnreadableFileError(f"cannot be read (it is {what})", "name a file")
        with path.open("rb") as stream:
            content = _read_up_to(stream, most_megabytes * MEGABYTE + 1)
    except OSError as error:
        raise UnreadableFileError(
            f"cannot be read ({error.strerror or error})", "check the path and its permissions"
        ) from error
    except ValueError as error:
        # A path with a zero byte in it.
        raise UnreadableFileError(f"cannot be read ({error})", "correct the path") from error
    if len(content) > most_megabytes * MEGABYTE:
        raise UnreadableFileError(
            f"is larger than {most_megabytes} MB", "check that it is the right file"
        )
    return content


def _read_up_to(stream: BinaryIO, most: int) -> bytes:
    """Read at most so many bytes; memory is taken for what is there, not for what might be."""
    expected = os.fstat(stream.fileno()).st_size + 1
    parts = [stream.read(min(expected, most))]
    left = most - len(parts[0])
    # A pipe has no size, and a file may grow while it is read.
    while left and (part := stream.read(min(left, MEGABYTE))):
        parts.append(part)
        left -= len(part)
    return b"".join(parts) if len(parts) > 1 else parts[0]
