"""Time columns: numbers of seconds, dates with times, or times of day."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.dated_cells import parse_dates
from fieldlink.site.number_cells import NumberCells
from fieldlink.site.numbered_times import TIME_UNITS, to_seconds
from fieldlink.site.times import NoClockError, Times
from fieldlink.site.times_of_day import is_time_of_day, parse_times_of_day

__all__ = ["Sampling", "parse_times", "sampling_of", "typical_interval"]

_COMPACT = re.compile(
    r"((?:19|20)\d{2})(0[1-9]|1[0-2])(0[1-9]|[12]\d|3[01])"
    r"[T ]?([01]\d|2[0-3])([0-5]\d)(?:([0-5]\d)(?:[.,]?(\d{1,6}))?)?"
)
"""A date and time without marks between its parts: 20261105120000."""
_MOST_MULTIPLES = 10.0
"""Samples from row to row, in the middle, above which the shortest interval is no period: of ten
samples nine would be missing, and nothing could be judged."""
_REGULAR = 0.05
"""Share of the period by which an interval may differ and still count as regular."""

_ROUNDED = 0.1
"""Least share of the shorter and of the longer intervals where stamps are cut to a coarser clock: a
rarer long one is a row that is missing."""
_OTHERS = 0.05
"""Share of longer intervals up to which they are gaps of such a record."""

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
        clock: seconds of a count of the clock to which the stamps are cut; None where they are not.
    """

    seconds: Floats
    start: float | None
    period: float
    irregular: int
    shortest: float
    longest: float
    clock: float | None = None


def parse_times(
    cells: Sequence[str],
    numbers: Callable[[Sequence[str]], NumberCells],
    *,
    unit: str | None,
    day_first: bool,
) -> Times:
    """Return the seconds of every cell.

    Args:
        cells: the column.
        numbers: turns cells into numbers.
        unit: what numbers count, see `numbered_times.find_time_unit`.
        day_first: see `dated_cells.parse_dates`.

    Raises:
        NoClockError: naming the first row that fits no notation of time.
    """
    filled = [index for index, cell in enumerate(cells) if cell]
    if len(filled) < 2:
        raise NoClockError("holds no times")
    first = cells[filled[0]]
    seconds = np.full(len(cells), np.nan)
    if _COMPACT.fullmatch(first):
        return parse_dates([_COMPACT.sub(_spell_out, cell) for cell in cells], filled,
                           day_first=day_first)  # fmt: skip
    sample = numbers([first])
    # Behind a number stands a unit of time, behind the day of a date its month.
    if not np.isnan(sample.values[0]) and (not sample.unit or sample.unit in TIME_UNITS):
        unit = sample.unit or unit
        found = to_seconds(_values(cells, filled, numbers), unit)
        seconds[filled] = found.seconds
        is_known = unit is not None or found.note is not None
        return Times(seconds, found.origin, note=found.note, is_unit_known=is_known)
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
    rounded = _interval_of_rounded(steps)
    first = float(seconds[known[0]] - known[0] * period)
    return Sampling(
        seconds - first,
        None if times.origin is None else times.origin + first,
        period,
        irregular,
        float(steps.min()),
        float(steps.max()),
        None if rounded is None or abs(rounded[0] - period) > 0.0 else rounded[1],
    )


def typical_interval(seconds: Floats, rows: NDArray[np.int64]) -> float:
    """Return the interval from row to row: the median, or what all intervals are multiples of.

    A historian that keeps a row only when a value changes has intervals of one, two, three samples.
    Rows counted by their median are soon many samples from their time, which they are not where
    stamps are merely rounded or late. With fine stamps all intervals are multiples of the shortest,
    which is chance then.

    Args:
        seconds: times, not NaN.
        rows: their rows.
    """
    # Over an empty cell the interval is shared by the rows it spans.
    steps = np.diff(seconds) / np.diff(rows)
    if steps.size == 0:
        return math.nan
    median, shortest = float(np.median(steps)), float(steps.min())
    others = np.count_nonzero(np.abs(steps - median) > _REGULAR * median)
    if others == 0:
        # Over the whole record the digits that stamps lack do not count.
        return float((seconds[-1] - seconds[0]) / (rows[-1] - rows[0]))
    rounded = _interval_of_rounded(steps)
    if rounded is not None:
        return rounded[0]
    is_regular = others <= 0.5 * steps.size
    if is_regular or not shortest > 0.0:
        return median
    multiples = steps / shortest
    if median > _MOST_MULTIPLES * shortest or np.any(
        np.abs(multiples - np.rint(multiples)) > _REGULAR
    ):
        return median
    drift = seconds - np.polyval(np.polyfit(rows, seconds, 1), rows)
    return shortest if float(np.std(drift)) > median else median


def _interval_of_rounded(steps: Floats) -> tuple[float, float] | None:
    """The interval of samples whose stamps are cut to a coarser clock, and the clock's count.

    Samples 2.5 s apart have stamps of whole seconds 2, 3, 2, 3 s apart. No interval is the period,
    and over any number of rows the sum is less than one count of the clock off, which it does not
    stay where rows are missing by chance. None for other stamps.
    """
    shortest = float(steps.min())
    if not shortest > 0.0:
        return None
    tie = _REGULAR * shortest
    longer = steps[steps > shortest + tie]
    if longer.size == 0:
        return None
    clock = float(longer.min()) - shortest
    short = steps <= shortest + tie
    pair = short | (np.abs(steps - shortest - clock) <= tie)
    both = min(np.count_nonzero(short), np.count_nonzero(pair & ~short))
    if clock > shortest - tie and not _is_count_of_clock(clock):
        return None
    if clock > shortest + tie or both < _ROUNDED * steps.size:
        return None
    if np.count_nonzero(~pair) > _OTHERS * steps.size:
        return None
    # Rows and stamps of each part between gaps, about their means.
    ends = [0, *(np.flatnonzero(~pair) + 1).tolist(), steps.size + 1]
    stamps = np.concatenate([[0.0], np.cumsum(steps)])
    parts = [stamps[first:last] - stamps[first:last].mean() for first, last in pairwise(ends)]
    rows = [np.arange(part.size) - 0.5 * (part.size - 1) for part in parts]
    period = float(np.concatenate(parts) @ np.concatenate(rows) / sum(n @ n for n in rows))
    for part, row in zip(parts, rows, strict=True):
        if np.ptp(part - period * row) > clock + _REGULAR * period:
            return None
    return period, clock


def _is_count_of_clock(seconds: float) -> bool:
    """Whether clocks count so: minutes, seconds, tenths; of 5 s and 10 s every other row lacks."""
    power = math.log10(seconds)
    return abs(seconds - 60.0) < _REGULAR or abs(power - round(power)) < 1e-3


def _spell_out(found: re.Match[str]) -> str:
    year, month, day, hour, minute, second, fraction = found.groups()
    return f"{year}-{month}-{day} {hour}:{minute}:{second or '00'}.{fraction or '0'}"


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
