"""A file that is written beside its final name: what is left of it when writing fails."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

__all__ = ["remove_unfinished"]


def remove_unfinished(file: Path) -> None:
    """Remove a file that is not finished, if it is there.

    Where the file system cannot do that either (it is read-only), the error that ended the writing
    is the one to report, and the rest of the file stays.
    """
    with suppress(OSError):
        file.unlink(missing_ok=True)
