"""What is wrong with a site file or a recording: each problem with its place and remedy."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from fieldlink.errors import FieldlinkError
from fieldlink.printable import as_printable, shortened

__all__ = ["Problem", "RecordingError", "SiteError", "nearest", "several_loops"]

_NAMED = 12
"""Loops that a sentence names."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong.

    Attributes:
        file: the file it is in.
        key: dotted TOML key, or column; empty when it concerns the whole file.
        message: what is wrong, with the value and the limit.
        remedy: what to do about it.
        line: 1-based line of the file, None when not known.
    """

    file: str
    key: str
    message: str
    remedy: str
    line: int | None = None

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        key = f"{shortened(self.key)}: " if self.key else ""
        # Names of keys and tags come from files: nothing in them may be obeyed where this is shown.
        return as_printable(f"{place}: {key}{self.message}; {self.remedy}")


class _ProblemsError(FieldlinkError):
    """Carries the problems, file by file and line by line; their texts make the message."""

    may_pass = False

    def __init__(self, problems: Iterable[Problem]) -> None:
        found = tuple(problems)
        files = list(dict.fromkeys(problem.file for problem in found))
        self.problems = tuple(
            sorted(found, key=lambda problem: (files.index(problem.file), problem.line or 0))
        )
        super().__init__("\n".join(map(str, self.problems)))


class SiteError(_ProblemsError):
    """A site file, or a file it names, that cannot be used."""


class RecordingError(_ProblemsError):
    """A recorded loop that cannot be used."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a remedy that suggests the known names, the one most like ``name`` first."""
    names = list(known)
    folded = {candidate.lower(): candidate for candidate in names}
    close = difflib.get_close_matches(name.lower(), list(folded), n=1, cutoff=0.6)
    if close:
        return f"did you mean {folded[close[0]]!r}?"
    if not names:
        return "there is none to choose from"
    shown = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return f"use one of: {shown}"


def several_loops(file: str, column: str, loops: Sequence[str], line: int | None = None) -> Problem:
    """Return the problem of a file with several loops where one is wanted.

    Args:
        file: its path.
        column: by which they are told apart; empty for loops side by side.
        loops: their names.
        line: of the header, 1-based.
    """
    more = ", ..." if len(loops) > _NAMED else ""
    beside = "" if column else " side by side"
    what = f"holds {len(loops)} loops{beside}: {', '.join(map(repr, loops[:_NAMED]))}{more}"
    remedy = (
        f"name one with --loop {loops[0]!r} (fieldlink identify, diagnose), or take all of them "
        "with fieldlink diagnose, report or assess"
    )
    return Problem(file, column, what, remedy, line)
