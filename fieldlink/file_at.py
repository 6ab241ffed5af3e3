"""Whether a path leads to a file, or a folder may be written, whatever stands in the way."""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from pathlib import Path

__all__ = ["is_pipe_or_device", "stamp_of_file", "why_closed", "why_no_file", "why_not_writable"]


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


def stamp_of_file(path: Path) -> tuple[int, int, int] | None:
    """Return what changes when a file is written or replaced; None where there is none to see."""
    try:
        found = path.stat()
    except OSError:
        # Who replaces a file may take it away for a moment before.
        return None
    return (found.st_mtime_ns, found.st_size, found.st_ino)


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


def why_closed(file: Path) -> str | None:
    """Return why a file may not be written though its folder may, and the remedy; None if it may.

    As a rule somebody has run a command as root once, and its files are root's.
    """
    if sys.platform == "win32":
        return None
    try:
        owner = file.stat().st_uid
    except OSError:
        return None
    is_open = os.access(file, os.R_OK | os.W_OK, effective_ids=True)
    if is_open or why_not_writable(file.parent):
        return None
    if owner == os.geteuid():
        return f"{file} is closed to its owner; chmod u+rw {file}"
    other, me = _account(owner), _account(os.geteuid())
    return (
        f"{file} belongs to {other}, because a command was run as {other} once; give the folder "
        f"back: chown -R {me} {file.parent}"
    )


def _account(number: int) -> str:
    import pwd  # not on Windows

    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return str(number)
