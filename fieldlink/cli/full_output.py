"""Standard output that cannot take what a command prints, as on a full disk."""

from __future__ import annotations

import contextlib
import os
import sys

import typer

__all__ = ["flush_output", "is_output_lost"]


def flush_output() -> None:
    """Write what is still in the buffer of standard output.

    Python's own end would find out too late to say it in words.

    Raises:
        OSError: it cannot be written.
    """
    # There is none where the caller closed it (>&-).
    if sys.stdout is not None and not sys.stdout.closed:
        sys.stdout.flush()


def is_output_lost(error: Exception) -> bool:
    """Say in one sentence that standard output cannot be written, if that is the error."""
    if not isinstance(error, OSError) or error.filename is not None or sys.stdout is None:
        return False
    try:
        flush_output()
        # What is not buffered is gone: one more byte tells whose error it is.
        os.write(sys.stdout.fileno(), b"\n")
    except (OSError, ValueError) as again:
        if not isinstance(again, OSError) or again.errno != error.errno:
            return False
    else:
        return False
    words = (
        f"fieldlink: the output cannot be written completely ({error.strerror}); free space where "
        "it goes, and run the command again"
    )
    # The standard error may go to the same disk: the exit status has to tell then.
    with contextlib.suppress(OSError):
        typer.secho(words, err=True, fg=typer.colors.RED)
    # What is left in the buffer would fail again at Python's end.
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())
    return True
