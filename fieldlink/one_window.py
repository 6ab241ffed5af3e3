"""How many samples are judged as one window, and what becomes of a recording that has more.

``identify`` refuses such a recording, because the user knows which part matters; ``report`` judges
the newest part and says so on its page; ``assess`` judges all of it, window after window.
"""

from __future__ import annotations

import shlex
from dataclasses import replace
from typing import TYPE_CHECKING

from fieldlink.errors import FieldlinkError

if TYPE_CHECKING:
    from fieldlink.site.recording import Recording

__all__ = ["LONGEST_WINDOW", "TooLongError", "keep_newest", "refuse_too_long"]

LONGEST_WINDOW = 20_000
"""Samples: half a minute and 0.8 GB on one core, both growing faster than the samples; a day at 1 s
needs 2.2 GB. A valve shows in fewer: a stroke of OP takes tens to hundreds of samples."""


class TooLongError(FieldlinkError):
    """A recording with more samples than one window may have."""


def refuse_too_long(name: str, samples: int, rows: slice) -> None:
    """Refuse more samples than one window may have.

    Args:
        name: the recording, for the message.
        samples: how many would be judged.
        rows: from where to where in the recording.

    Raises:
        TooLongError: there are too many.
    """
    if samples <= LONGEST_WINDOW:
        return
    fitting = (rows.stop - rows.start) * LONGEST_WINDOW // samples
    raise TooLongError(
        f"{name}: {samples} samples are too many for one window (at most {LONGEST_WINDOW}); name "
        f"rows with --window, for the newest --window {rows.stop - fitting}:{rows.stop}, or judge "
        f"all of it window by window: fieldlink assess {shlex.quote(name)} --out FOLDER"
    )


def keep_newest(recording: Recording) -> Recording:
    """The newest part of a recording that one window may have, with a note where that cuts it."""
    rows = len(recording)
    if rows <= LONGEST_WINDOW:
        return recording
    note = (
        f"the newest {LONGEST_WINDOW} of {rows} samples are judged, the most for one window; "
        "fieldlink assess judges all of them, window by window"
    )
    newest = recording.cut(slice(rows - LONGEST_WINDOW, rows))
    return replace(newest, notes=(*newest.notes, note))
