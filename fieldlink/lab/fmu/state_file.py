"""A plant's state in a file: only the FMU that it was saved from takes it back."""

from __future__ import annotations

import hashlib
from pathlib import Path

from fieldlink.lab.fmu.errors import FmuError
from fieldlink.unfinished_file import write_whole

__all__ = ["load_state", "save_state"]

_MARK = b"fieldlink fmu state 1\n"


def _digest(fmu: Path) -> bytes:
    return hashlib.sha256(fmu.read_bytes()).digest()


def save_state(file: Path, fmu: Path, snapshot: bytes) -> None:
    """Write a snapshot of the plant ``fmu`` into ``file``.

    Raises:
        FmuError: it cannot be written.
    """
    try:
        write_whole(file, _MARK + _digest(fmu) + snapshot)
    except OSError as error:
        raise FmuError(f"{file}: the state cannot be written: {error.strerror}") from error


def load_state(file: Path, fmu: Path) -> bytes:
    """Return the snapshot in ``file``.

    Raises:
        FmuError: unreadable, no such file of ours, or of another FMU.
    """
    try:
        content = file.read_bytes()
    except OSError as error:
        raise FmuError(f"{file}: the state cannot be read: {error}") from error
    if not content.startswith(_MARK):
        raise FmuError(f"{file}: this file was not written by --save-state")
    start = len(_MARK)
    if content[start : start + 32] != _digest(fmu):
        raise FmuError(
            f"{file}: the state is of another FMU than {fmu.name}, or of another build of it; run "
            "it again from the start"
        )
    return content[start + 32 :]
