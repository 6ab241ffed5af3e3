"""Times without a date: hours, minutes and seconds of a day, or minutes and seconds.

    parse_times_of_day(["11:59:58 PM", "12:00:00 AM"], [0, 1])  # 86398 s, 86400 s
    parse_times_of_day(["59:58.0", "00:00.0"], [0, 1])          # 3598 s, 3600 s

They go on after midnight, or after the full hour where there are no hours.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.times import NoClockError

__all__ = [
    "HALF_OF_DAY",
    "has_hours",
    "is_time_of_day",
    "parse_times_of_day",
    "spell_out_times",
]

_HOUR, _DAY = 3600.0, 86400.0
HALF_OF_DAY = re.compile(r"\s?([ap])\.?\s?m\.?$", re.IGNORECASE)
"""AM or PM behind a time, with points or without."""
_CLOCK = re.compile(r"(?:(\d+) days?,? )?(\d{1,4}):(\d{2})(?::(\d{2}(?:[.,]\d+)?))?")
_MINUTES = re.compile(r"(\d{1,4}):(\d{2}[.,]\d+)")
"""What spreadsheets show as mm:ss.0."""
_DIGITS = re.compile(r"([01]\d|2[0-3])([0-5]\d)([0-5]\d)")

Floats = NDArray[np.float64]


def is_time_of_day(cell: str) -> bool:
    """Whether a cell is a time without a date."""
    return has_hours(cell) or _MINUTES.fullmatch(cell) is not None


def has_hours(cell: str) -> bool:
    """Whether a cell is a time without a date that may stand behind one."""
    return _CLOCK.fullmatch(HALF_OF_DAY.sub("", cell)) is not None


def spell_out_times(cells: Sequence[str]) -> list[str] | None:
    """Return times that are digits alone, such as 90002, as 09:00:02; None unless all are.

    A count of seconds soon has two digits that no clock shows.
    """
    if not next(filter(None, cells), "").isdigit():
        return None
    found = [_DIGITS.fullmatch(cell.zfill(6)) if cell else None for cell in cells]
    if max(map(len, cells), default=0) < 3 or any(
        cell and not digits for cell, digits in zip(cells, found, strict=True)
    ):
        return None
    return [":".join(digits.groups()) if digits else "" for digits in found]


def parse_times_of_day(cells: Sequence[str], filled: Sequence[int]) -> tuple[Floats, str | None]:
    """Return the seconds of the filled cells, and how they were read where that is not plain.

    Args:
        cells: the column.
        filled: indices of the cells that are not empty.

    Raises:
        NoClockError: naming the first cell that is not a time of day.
    """
    texts = [cells[index] for index in filled]
    pairs = [found for text in texts if (found := re.fullmatch(r"(\d{1,4}):\d{2}([.,]\d+)?", text))]
    if len(pairs) < len(texts):
        return _go_on([_clock(cells, index) for index in filled], _DAY), None
    # A day has 24 hours; what counts further, or has fractions, counts minutes.
    minutes = [int(found[1]) for found in pairs]
    if max(minutes) > 23 or any(found[2] for found in pairs):
        return _go_on([_clock(cells, index) / 60.0 for index in filled], _HOUR), (
            "is read as minutes and seconds"
        )
    return _go_on([_clock(cells, index) for index in filled], _DAY), (
        "is read as hours and minutes; write 0:MM:SS if it counts minutes and seconds"
    )


def _clock(cells: Sequence[str], index: int) -> float:
    """Seconds of a cell; of one without seconds, its first number is hours."""
    text = cells[index]
    half = HALF_OF_DAY.search(text)
    plain = text[: half.start()] if half else text
    if found := _MINUTES.fullmatch(plain):
        return _HOUR * int(found[1]) + 60.0 * float(found[2].replace(",", "."))
    found = _CLOCK.fullmatch(plain)
    if found is None or (half and not 1 <= int(found[2]) <= 12):
        raise NoClockError(f"{text!r} is not a time of day", index)
    hours = int(found[2])
    if half:
        hours = hours % 12 + (12 if half[1] in "pP" else 0)
    seconds = float((found[4] or "0").replace(",", "."))
    return math.fsum((_DAY * int(found[1] or 0), _HOUR * hours, 60.0 * int(found[3]), seconds))


def _go_on(times: list[float], turn: float) -> Floats:
    """Times that begin again after ``turn`` seconds counted on, also where the newest is first."""
    values = np.array(times)
    steps = np.diff(values)
    forth = np.count_nonzero(steps > 0.0) >= np.count_nonzero(steps < 0.0)
    over = steps < -0.5 * turn if forth else steps > 0.5 * turn
    turns = np.concatenate([[0], np.cumsum(over)])
    counted: Floats = values + (turn if forth else -turn) * turns
    return counted
