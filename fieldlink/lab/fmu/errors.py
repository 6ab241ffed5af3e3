"""What a user of an FMU can get wrong."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from fieldlink.errors import FieldlinkError

__all__ = ["FmuError", "nearest"]


class FmuError(FieldlinkError):
    """A map, an input file or an experiment does not fit the FMU."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: the nearest known ones, or all."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=3, cutoff=0.4)
    if close:
        return f"did you mean {' or '.join(map(repr, close))}?"
    shown = ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")
    return f"there are: {shown or 'none'}"
