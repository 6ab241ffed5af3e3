"""Whether a path leads to a file, or a folder may be written, whatever stands in the way."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

__all__ = ["is_pipe_or_device", "why_no_file", "why_not_writable"]


def why_no_file(path: str | Path) -> str | None:
    """Return why there is no file to open at a path, as the system says it; None if there is one.

    `Path.is_file` raises where a folder on the way is closed to this user.
    """
    try:
        kind = os.stat(path).st_mode
    except (OSError, ValueError) as error:
        # ValueError: a path with a zero byte in it.
        return getattr(error, "strerror", None) or str(error)
    return None if stat.S_ISREG(kind) else "it is not a file"


def is_pipe_or_device(path: str | Path) -> bool:
    """Whether a path leads to neither a file nor a folder: opening a pipe waits for a writer."""
    return os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path))


def why_not_writable(folder: Path) -> str | None:
    """Return why no file can be made in a folder, or in the first one above it that is there.

    Nothing stays behind: the file of the trial has no name, or loses it at once.
    """
    while not folder.is_dir() and not os.path.lexists(folder) and folder != folder.parent:
        folder = folder.parent
    try:
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return error.strerror or str(error)
