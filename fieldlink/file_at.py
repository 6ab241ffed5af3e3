"""Whether a path leads to a file, also where a folder on its way may not be entered."""

from __future__ import annotations

import os
import stat
from pathlib import Path

__all__ = ["is_pipe_or_device", "why_no_file"]


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
