"""Dates with times, in the notations of people and programs.

ISO 8601 is tried first. In ``05.11.2026`` the day is first. In ``05/11/2026`` either may be: the
wrong reading makes months of days or jumps back, and where both are as good a note tells which was
taken.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.times import NoClockError, Times
from fieldlink.site.times_of_day import HALF_OF_DAY

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["is_date", "parse_dates"]

_DATE = re.compile(
    r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}[-/. ]+[a-z]{3,9}\.?[-/., ]+\d{2,4}"
    r"|[a-z]{3,9}\.? \d{1,2},? \d{2,4}|(19|20)\d{6}",
    re.IGNORECASE,
)
_WITH_OFFSET = re.compile(r"(Z|UTC|GMT|[+-]\d{2}:?\d{2})$")
_ZONE = re.compile(r"\d ?(?!(?:UTC|GMT|Z|AM|PM)$)([A-Z]{2,5})$")
_PARTS = re.compile(r"(?<!\d)(\d{1,4})([-/.])\d{1,2}\2\d{1,4}(?!\d)")
_MILLISECONDS_AFTER_COLON = re.compile(r"(\d:\d{2}:\d{2}):(\d{1,6})$")

Floats = NDArray[np.float64]


def is_date(cell: str) -> bool:
    """Whether a cell is a date without a time."""
    return _DATE.fullmatch(cell) is not None


def parse_dates(cells: Sequence[str], filled: Sequence[int], *, day_first: bool) -> Times:
    """Return the seconds of the filled cells since the first.

    Args:
        cells: the column.
        filled: indices of the cells that are not empty.
        day_first: whether the rest of the file is written as where the day stands before the month;
            counts where the dates themselves do not tell.

    Raises:
        NoClockError: naming the first cell that is not a date and time.
    """
    # Here, because only recordings with dates need pandas, and a daemon has none.
    import pandas as pd

    first = cells[filled[0]]
    if zone := _ZONE.search(first):
        raise NoClockError(
            f"{first!r} names a time zone, {zone[1]}, by letters that several zones share; "
            "write its offset, such as +01:00, or leave it out",
            filled[0],
        )
    texts = [_MILLISECONDS_AFTER_COLON.sub(r"\1.\2", cells[index]) for index in filled]
    has_halves = HALF_OF_DAY.search(first) is not None
    column = pd.Series([HALF_OF_DAY.sub(r" \1m", text) for text in texts] if has_halves else texts)
    seconds = np.full(len(cells), np.nan)
    is_local = not _WITH_OFFSET.search(first)
    iso = pd.to_datetime(column, utc=True, errors="coerce", format="ISO8601")
    if iso.notna().all():
        seconds[filled], origin = _seconds(iso)
        return Times(seconds, origin, is_local)
    # Where nothing else tells, the hours of the twelve-hour clock go with the month first.
    orders = _orders_of(first, prefers_day=day_first and not has_halves)
    readings = [
        pd.to_datetime(column, utc=True, errors="coerce", format="mixed", dayfirst=order)
        for order in orders
    ]
    complete = [stamps for stamps in readings if stamps.notna().all()]
    if not complete:
        best = max((iso, *readings), key=lambda stamps: int(stamps.notna().sum()))
        wrong = filled[int(np.flatnonzero(best.isna().to_numpy())[0])]
        raise NoClockError(f"{cells[wrong]!r} is not a date and time", wrong)
    spans = [stamps.max() - stamps.min() for stamps in complete]
    chosen = complete[spans.index(min(spans))]
    note = None
    if len(complete) == 2 and spans[0] == spans[1] and not complete[0].equals(complete[1]):
        this, other = (f"{stamps.iloc[0]:%Y-%m-%d}" for stamps in complete)
        note = f"has {first!r}, which is read as {this}; write the year first if it is {other}"
    seconds[filled], origin = _seconds(chosen)
    return Times(seconds, origin, is_local, note)


def _orders_of(date: str, *, prefers_day: bool) -> tuple[bool, ...]:
    """Whether the day may stand before the month in a date, the likelier answer first."""
    parts = _PARTS.search(date)
    if parts is not None and len(parts[1]) > 2:
        return (False,)
    if parts is not None and parts[2] == ".":
        return (True,)
    return (True, False) if prefers_day else (False, True)


def _seconds(stamps: pd.Series[pd.Timestamp]) -> tuple[Floats, float]:
    """Seconds since the first stamp, which keeps their digits, and the first stamp's own."""
    elapsed = stamps - stamps.iloc[0]
    seconds = np.asarray(elapsed.dt.total_seconds(), dtype=np.float64)
    return seconds, stamps.iloc[0].timestamp()
