"""Time columns: numbers of seconds, dates with times, or times of day."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.dated_cells import parse_dates
from fieldlink.site.number_cells import NumberCells
from fieldlink.site.times import NoClockError, Times
from fieldlink.site.times_of_day import is_time_of_day, parse_times_of_day

__all__ = [
    "Sampling", "counts_a_second", "is_moment", "parse_times", "sampling_of", "typical_interval",
]  # fmt: skip

_DAY = 86400.0
_DATED_FROM, _DATED_TO = 946_684_800.0, 4_102_444_800.0
"""Numbers between the years 2000 and 2100, taken as seconds since 1970, are moments."""
_COUNTS_A_SECOND = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
"""What logs and databases count since 1970."""
_SPREADSHEET_EPOCH = 25569.0
"""1 January 1970 as a spreadsheet's number of days."""
_FINE_DAYS = 0.01
"""Days, a quarter of an hour: times that spread over years and step less are numbers of days. In
seconds they would be a hundred samples a second, begun ten hours after their zero."""
_REGULAR = 0.05
"""Share of the period by which an interval may differ and still count as regular."""

Floats = NDArray[np.float64]


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
    """Whether a number of seconds counts from 1970, not from the start of a recording."""
    return _DATED_FROM <= seconds < _DATED_TO


def counts_a_second(number: float) -> tuple[str, float] | None:
    """Return what a number since 1970 counts, and how many of that a second has; else None."""
    units = _COUNTS_A_SECOND.items()
    return next(((unit, counts) for unit, counts in units if is_moment(number / counts)), None)


def parse_times(
    cells: Sequence[str], numbers: Callable[[Sequence[str]], NumberCells], *, day_first: bool
) -> Times:
    """Return the seconds of every cell.

    Args:
        cells: the column.
        numbers: turns cells into numbers.
        day_first: see `dated_cells.parse_dates`.

    Raises:
        NoClockError: naming the first row that fits no notation of time.
    """
    filled = [index for index, cell in enumerate(cells) if cell]
    if len(filled) < 2:
        raise NoClockError("holds no times")
    first = cells[filled[0]]
    seconds = np.full(len(cells), np.nan)
    sample = numbers([first])
    # Behind a number stands a unit, behind the day of a date its month.
    if not np.isnan(sample.values[0]) and not sample.unit:
        values = _values(cells, filled, numbers)
        seconds[filled], origin, note = _as_seconds(values)
        return Times(seconds, origin, note=note)
    if is_time_of_day(first):
        seconds[filled], note = parse_times_of_day(cells, filled)
        return Times(seconds, None, note=note)
    return parse_dates(cells, filled, day_first=day_first)


def sampling_of(times: Times) -> Sampling:
    """Return the period and regularity of a time column.

    Raises:
        NoClockError: the times do not increase.
    """
    seconds = times.seconds
    known = np.flatnonzero(~np.isnan(seconds))
    steps = np.diff(seconds[known]) / np.diff(known)
    period = typical_interval(seconds[known], known)
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


def typical_interval(seconds: Floats, rows: NDArray[np.int64]) -> float:
    """Return the interval from row to row: the median, or what all intervals are multiples of.

    A historian that keeps a row only when a value changes has intervals of one, two, three samples.
    Rows counted by their median are soon many samples from their time, which they are not where
    stamps are merely rounded or late.

    Args:
        seconds: times, not NaN.
        rows: their rows.
    """
    # Over an empty cell the interval is shared by the rows it spans.
    steps = np.diff(seconds) / np.diff(rows)
    if steps.size == 0:
        return math.nan
    median, shortest = float(np.median(steps)), float(steps.min())
    is_regular = np.count_nonzero(np.abs(steps - median) > _REGULAR * median) <= 0.5 * steps.size
    if is_regular or not shortest > 0.0:
        return median
    multiples = steps / shortest
    if np.any(np.abs(multiples - np.rint(multiples)) > _REGULAR):
        return median
    drift = seconds - np.polyval(np.polyfit(rows, seconds, 1), rows)
    return shortest if float(np.std(drift)) > median else median


def _as_seconds(values: Floats) -> tuple[Floats, float | None, str | None]:
    """Numbers as seconds, with their origin and how they were read."""
    if is_moment(values[0]):
        return values, 0.0, None
    if (counted := counts_a_second(values[0])) is not None:
        unit, counts = counted
        return values / counts, 0.0, f"holds {unit} since 1970"
    days = (values - _SPREADSHEET_EPOCH) * _DAY
    if is_moment(days[0]) and is_moment(days[-1]) and abs(np.median(np.diff(values))) < _FINE_DAYS:
        return np.round(days, 3), 0.0, "holds days, as a spreadsheet counts them"
    return values, None, None


def _values(
    cells: Sequence[str], filled: Sequence[int], numbers: Callable[[Sequence[str]], NumberCells]
) -> Floats:
    found = numbers([cells[index] for index in filled])
    if found.ambiguous is not None:
        raise NoClockError(f"{found.ambiguous!r} may be a decimal comma or grouped digits")
    for index in np.flatnonzero(np.isnan(found.values)).tolist():
        wrong = filled[index]
        raise NoClockError(f"{cells[wrong]!r} is not a number of seconds", wrong)
    return found.values
