"""Which windows are one loop's: a history is often stored a file a day, or a folder a month.

    named_by_file(Path("history/FC101_2026-01-05.csv"), start)    # FC101
    history_of("history/2026-01-05/all.csv", start)               # history//all.csv

A date in a path counts when the samples are of about that time: ``FIC-2001-05-01`` may be a tag.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

from fieldlink.printable import as_text

__all__ = ["history_of", "named_by_file"]

_FROM_DAY, _FROM_MONTH = timedelta(days=400), timedelta(days=32)
"""Between a day or a month in a path and the first sample, at most: a year of samples may be named
by the day of their export. Months are looked at more closely: ``FIC-2001-05`` is a usual tag."""

_TIME = r"(?:(?:[T_. -]?(?:[01]\d|2[0-3])[-_:.h]?[0-5]\d(?:[-_:.m]?[0-5]\d)?|T?\d\d)Z?)?(?!\d)"
_DATES: tuple[tuple[re.Pattern[str], tuple[str, ...]], ...] = (
    (
        re.compile(rf"(?<!\d)(?P<y>(?:19|20)\d\d)([-_./])(?P<m>\d\d?)\2(?P<d>\d\d?){_TIME}"),
        ("ymd",),
    ),
    (
        re.compile(rf"(?<!\d)(?P<m>\d\d?)([-_.])(?P<d>\d\d?)\2(?P<y>(?:19|20)\d\d){_TIME}"),
        ("ymd", "ydm"),
    ),
    (re.compile(rf"(?<!\d)(?P<y>(?:19|20)\d\d)(?P<m>\d\d)(?P<d>\d\d){_TIME}"), ("ymd",)),
    (re.compile(r"(?<!\d)(?P<y>(?:19|20)\d\d)([-_/])(?P<m>\d\d)(?!\d)"), ("ym",)),
)
"""Dates as names of files and folders have them, with a time of day; and the order of their parts,
where several are possible all of them."""

_PARTITION = re.compile(
    r"(?<![^/\\])(?:date|dt|ts|year|month|week|day|hour|y|m|d|h)=\d[-\d_:.TZW%]*(?![^/\\])",
    re.IGNORECASE,
)
"""A folder of a partitioned data set that is of a time, such as ``year=2026``; not ``speed=3``."""
_LOOP_FOLDER = re.compile(r"(?:loop|tag)=(?P<loop>.+)", re.IGNORECASE)
_PART = re.compile(r"(?<![^/\\])part-\d+(?:[-.][^/\\]*)?\Z", re.IGNORECASE)
"""A file that a program has numbered: its name says nothing. ``part-12_boiler.csv`` does."""
_EDGES = " -_."


def named_by_file(path: Path, start: float | None) -> str:
    """Return the name of the only loop of a file.

    That is the file's name without a date and its ending; where nothing is left, that of the
    nearest folder that has one. A folder ``loop=FC101`` names it before.

    Args:
        path: the file, absolute.
        start: of its samples, seconds since 1970; None in a recording without dates.
    """
    for folder in reversed(path.parts[:-1]):
        if found := _LOOP_FOLDER.fullmatch(folder):
            return as_text(found["loop"])
    recorded = None if start is None else datetime.fromtimestamp(start, UTC).date()
    for part in (path.stem, *reversed(path.parts[1:-1])):
        name = _without_dates(_PART.sub("", part), recorded).strip(_EDGES)
        if name:
            return as_text(name)
    return as_text(path.stem)


def history_of(file: str, start: str | None) -> str:
    """Return what all files of one history have in common: the path without what dates it.

    Args:
        file: path or address, as the table shows it.
        start: of the first dated window in it, as the table has it; None where it has none.
    """
    if start is None:
        return file
    return _without_dates(_PART.sub("", file), datetime.fromisoformat(start).date())


def _without_dates(text: str, recorded: date | None) -> str:
    text = _PARTITION.sub("", text)
    if recorded is None:
        return text
    for pattern, orders in _DATES:
        text = pattern.sub(_remover(orders, recorded), text)
    return text


def _remover(orders: tuple[str, ...], recorded: date) -> Callable[[re.Match[str]], str]:
    """Replaces a date by nothing where one of its readings is near ``recorded``."""

    def replaced(found: re.Match[str]) -> str:
        for order in orders:
            parts = dict(zip(order, map(int, found.group(*"ymd"[: len(order)])), strict=True))
            is_day = "d" in parts
            try:
                first = date(parts["y"], parts["m"], parts.get("d", 1))
            except ValueError:
                continue
            around = _FROM_DAY if is_day else _FROM_MONTH
            last = first if is_day else first + timedelta(days=31)
            if first - around <= recorded <= last + around:
                return ""
        return found[0]

    return replaced
