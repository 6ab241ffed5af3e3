"""Times that are numbers: what they count, and from when.

    find_time_unit("Time [min]", ())           # "min"
    to_seconds(np.array([0.0, 0.5]), "min")    # 0 s, 30 s
    to_seconds(np.array([1772618400000.0]), None).origin    # moments, in milliseconds since 1970

A number that is a moment of the years 2000 to 2100 by one of the clocks of programs is one; others
count from the start of a recording, in the unit that the file names or in seconds.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "TIME_UNITS",
    "NumberedTimes",
    "counts_a_second",
    "find_time_unit",
    "is_moment",
    "is_plausible",
    "to_seconds",
]

_DATED_FROM, _DATED_TO = 946_684_800.0, 4_102_444_800.0
"""Numbers between the years 2000 and 2100, taken as seconds since 1970, are moments."""
_COUNTS_A_SECOND = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
"""What logs and databases count since 1970."""
_TICKS = {".NET ticks": -62_135_596_800.0, "Windows file times": -11_644_473_600.0}
"""Clocks of 100 ns, and when they begin (the years 1 and 1601) in seconds since 1970."""
_TICKS_A_SECOND = 1e7
_DAY = 86400.0
_DAYS = {
    "days, as a spreadsheet counts them": 25569.0,
    "days, as MATLAB counts them (datenum)": 719_529.0,
    "Julian days": 2_440_587.5,
}
"""Clocks of days, and 1 January 1970 by them."""
_FINE_DAYS = 0.01
"""Days, a quarter of an hour: times that spread over years and step less are numbers of days. In
seconds they would be a hundred samples a second, begun ten hours after their zero."""
_SHORTEST, _LONGEST = 1e-3, _DAY
"""Seconds between samples outside of which bare numbers do not count seconds: no controller of a
plant samples faster than each millisecond, and no oscillation of a loop shows in daily values."""

TIME_UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0, "d": _DAY}
"""Seconds of each unit."""
_SPELLED = {
    "ns": "nanosecond nanoseconds",
    "us": "\u00b5s \u03bcs microsecond microseconds",
    "ms": "msec msecs millis millisecond milliseconds millisekunden",
    "s": "sec secs second seconds sek sekunden secondes segundos",
    "min": "mins minute minutes minuten minutos",
    "h": "hr hrs hour hours std stunden heures horas",
    "d": "day days tage jours dias",
}
_WORDS = {word: unit for unit, words in _SPELLED.items() for word in (unit, *words.split())}

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class NumberedTimes:
    """Numbers as seconds.

    Attributes:
        seconds: as many as numbers.
        origin: seconds since 1970 (UTC) when ``seconds`` is 0, None for a recording's own time.
        note: how the numbers were read, where that is not plain.
    """

    seconds: Floats
    origin: float | None
    note: str | None = None


def is_moment(seconds: float) -> bool:
    """Whether a number of seconds counts from 1970, not from the start of a recording."""
    return _DATED_FROM <= seconds < _DATED_TO


def counts_a_second(number: float) -> tuple[str, float] | None:
    """Return what a number since 1970 counts, and how many of that a second has; else None."""
    units = _COUNTS_A_SECOND.items()
    return next(((unit, counts) for unit, counts in units if is_moment(number / counts)), None)


def is_plausible(period: float) -> bool:
    """Whether samples may be this many seconds apart, where nothing names the unit of times."""
    return _SHORTEST <= period <= _LONGEST


def find_time_unit(heading: str, below: Sequence[str]) -> str | None:
    """Return the unit of a time column, a key of `TIME_UNITS`; None where nothing names it.

    Args:
        heading: of the column: ``Time [min]``, ``time_ms``, ``t in h``, ``seconds``.
        below: what stands between the heading and the first sample, such as a row of units.
    """
    for text in (*re.findall(r"[\[(](.*?)[\])]", heading), *below):
        if (unit := _WORDS.get(text.strip(" []()").casefold())) is not None:
            return unit
    words = [word for word in re.split(r"[^a-z\u00b5\u03bc]+", heading.casefold()) if word]
    if len(words) > 1:
        return _WORDS.get(words[-1])
    # Alone, a short word or a singular may be a name.
    return _WORDS.get(words[0]) if words and len(words[0]) > 4 and words[0][-1] in "sn" else None


def to_seconds(values: Floats, unit: str | None) -> NumberedTimes:
    """Return numbers as seconds.

    Args:
        values: the numbers in the order of the file, shape ``(n,)``, none NaN.
        unit: a key of `TIME_UNITS`, None where the file names none.
    """
    first, last = float(values[0]), float(values[-1])
    scale = 1.0 if unit is None else TIME_UNITS[unit]
    if is_moment(first * scale):
        note = None if scale == 1.0 else f"counts {unit} since 1970"
        return NumberedTimes(values * scale, 0.0, note)
    if (counted := counts_a_second(first)) is not None:
        name, counts = counted
        return NumberedTimes(values / counts, 0.0, f"holds {name} since 1970")
    for name, begin in _TICKS.items():
        if is_moment(first / _TICKS_A_SECOND + begin):
            # From the first on, whose digits a float does not hold beside those of the steps.
            origin = first / _TICKS_A_SECOND + begin
            return NumberedTimes((values - first) / _TICKS_A_SECOND, origin, f"holds {name}")
    if unit in (None, "d") and abs(np.median(np.diff(values))) < _FINE_DAYS:
        for name, epoch in _DAYS.items():
            if is_moment((first - epoch) * _DAY) and is_moment((last - epoch) * _DAY):
                return NumberedTimes(np.round((values - epoch) * _DAY, 3), 0.0, f"holds {name}")
    note = None if scale == 1.0 else f"counts {unit}: taken as seconds"
    return NumberedTimes(values * scale, None, note)
