"""A defect of the program, as one line: what was raised, and where."""

from __future__ import annotations

import traceback
from pathlib import Path

__all__ = ["describe_defect"]


def describe_defect(error: BaseException) -> str:
    """Return an unforeseen error and its place, in one line for a report."""
    frames = traceback.extract_tb(error.__traceback__)
    where = f" at {Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""
    said = " ".join(str(error).split())
    return f"{type(error).__name__}{f' ({said})' if said else ''}{where}"
