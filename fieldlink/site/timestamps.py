"""Time columns: numbers of seconds, dates with times, or times of day."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["NoClockError", "Sampling", "Times", "is_moment", "parse_times", "sampling_of"]

_DAY = 86400.0
_DATED_FROM, _DATED_TO = 946_684_800.0, 4_102_444_800.0
"""Numbers between the years 2000 and 2100, taken as seconds since 1970, are moments."""
_TIME_OF_DAY = re.compile(r"^\d{1,2}:\d{2}(:\d{2}([.,]\d+)?)?$")
_REGULAR = 0.05
"""Share of the period by which an interval may differ and still count as regular."""

Floats = NDArray[np.float64]


class NoClockError(ValueError):
    """A column without a readable time; ``index`` is the row at fault, if one is."""

    def __init__(self, message: str, index: int | None = None) -> None:
        self.index = index
        super().__init__(message)


@dataclass(frozen=True, slots=True, eq=False)
class Times:
    """A time column in seconds.

    Attributes:
        seconds: one for each cell, NaN for an empty one.
        origin: seconds since 1970 (UTC) when ``seconds`` is 0, None without a date.
    """

    seconds: Floats
    origin: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Sampling:
    """What a time column says.

    Attributes:
        seconds: since the first row, NaN where the cell is empty.
        start: of the first row, seconds since 1970 (UTC), None without a date.
        period: median interval in seconds.
        irregular: intervals that differ from the period by more than a twentieth of it.
        shortest, longest: intervals in seconds.
    """

    seconds: Floats
    start: float | None
    period: float
    irregular: int
    shortest: float
    longest: float


def is_moment(seconds: float) -> bool:
    """Whether a number of seconds counts from 1970, not from the begin of a recording."""
    return _DATED_FROM <= seconds < _DATED_TO


def parse_times(cells: Sequence[str], number: Callable[[str], float]) -> Times:
    """Return the seconds of every cell.

    Args:
        cells: the column.
        number: turns text into a number or raises ValueError.

    Raises:
        NoClockError: naming the first row that fits no notation of time.
    """
    filled = [index for index, cell in enumerate(cells) if cell]
    if len(filled) < 2:
        raise NoClockError("holds no times")
    seconds = np.full(len(cells), np.nan)
    seconds[filled], origin = _parse(cells, filled, number)
    return Times(seconds, origin)


def sampling_of(times: Times) -> Sampling:
    """Return the period and regularity of a time column.

    Raises:
        NoClockError: the times do not increase.
    """
    seconds = times.seconds
    known = np.flatnonzero(~np.isnan(seconds))
    # Over an empty cell the interval is shared by the rows it spans.
    steps = np.diff(seconds[known]) / np.diff(known)
    period = float(np.median(steps))
    if not period > 0.0:
        raise NoClockError(f"the times do not increase (median interval {period:g} s)")
    irregular = int(np.count_nonzero(np.abs(steps - period) > _REGULAR * period))
    first = float(seconds[known[0]] - known[0] * period)
    return Sampling(
        seconds - first,
        None if times.origin is None else times.origin + first,
        period,
        irregular,
        float(steps.min()),
        float(steps.max()),
    )


def _parse(
    cells: Sequence[str], filled: list[int], number: Callable[[str], float]
) -> tuple[Floats, float | None]:
    first = cells[filled[0]]
    if _is_number(first, number):
        values = np.array([_number_at(cells, index, number) for index in filled])
        return values, 0.0 if is_moment(values[0]) else None
    if _TIME_OF_DAY.match(first):
        return _unwrap([_time_of_day(cells, index) for index in filled]), None
    return _dates(cells, filled)


def _is_number(cell: str, number: Callable[[str], float]) -> bool:
    try:
        number(cell)
    except ValueError:
        return False
    return True


def _number_at(cells: Sequence[str], index: int, number: Callable[[str], float]) -> float:
    try:
        return number(cells[index])
    except ValueError as error:
        raise NoClockError(f"{cells[index]!r} is not a number of seconds", index) from error


def _time_of_day(cells: Sequence[str], index: int) -> float:
    cell = cells[index]
    if not _TIME_OF_DAY.match(cell):
        raise NoClockError(f"{cell!r} is not a time of day", index)
    parts = [float(part) for part in cell.replace(",", ".").split(":")]
    return math.fsum(part * unit for part, unit in zip(parts, (3600.0, 60.0, 1.0), strict=False))


def _unwrap(times: list[float]) -> Floats:
    """Times of day go on after midnight."""
    values = np.array(times)
    midnights = np.concatenate([[0], np.cumsum(np.diff(values) < -0.5 * _DAY)])
    unwrapped: Floats = values + _DAY * midnights
    return unwrapped


def _dates(cells: Sequence[str], filled: list[int]) -> tuple[Floats, float]:
    """ISO 8601 is tried first; of day first and month first the reading of the shorter span counts.

    The wrong one of the two makes months of days or jumps back.
    """
    # Here, because only recordings with dates need pandas, and a daemon has none.
    import pandas as pd

    column = pd.Series([cells[index] for index in filled])
    iso = pd.to_datetime(column, utc=True, errors="coerce", format="ISO8601")
    if iso.notna().all():
        return _seconds(iso)
    readings = [
        pd.to_datetime(column, utc=True, errors="coerce", format="mixed", dayfirst=day_first)
        for day_first in (False, True)
    ]
    complete = [_seconds(stamps) for stamps in readings if stamps.notna().all()]
    if complete:
        return min(complete, key=lambda reading: float(np.ptp(reading[0])))
    best = max((iso, *readings), key=lambda stamps: int(stamps.notna().sum()))
    wrong = filled[int(np.flatnonzero(best.isna().to_numpy())[0])]
    raise NoClockError(f"{cells[wrong]!r} is not a date and time", wrong)


def _seconds(stamps: pd.Series[pd.Timestamp]) -> tuple[Floats, float]:
    """Seconds since the first stamp, which keeps their digits, and the first stamp's own."""
    elapsed = stamps - stamps.iloc[0]
    seconds = np.asarray(elapsed.dt.total_seconds(), dtype=np.float64)
    return seconds, stamps.iloc[0].timestamp()
