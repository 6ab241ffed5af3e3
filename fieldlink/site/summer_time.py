"""Local times over a change of summer time: an hour that is not there, or one that is there twice.

The stamps of the rows after it are moved by an hour, so that they count on. In rows sorted by local
time the samples of the repeated hour stand among each other, and nothing tells them apart.
"""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

__all__ = ["count_on", "leave_out_mixed_hours"]

_HOUR = 3600.0
_SUNDAYS = {3: (8, 25), 4: (1,), 9: (24,), 10: (1, 25), 11: (1,)}
"""By month, the day from which on the next Sunday is one on which clocks are set, by the rules in
force in Europe, North America, Australia and New Zealand."""
_UNTIL = 4
"""Full hour of a Sunday before which they are set."""
_MIXED = 0.8
"""Share of the stamps of an hour that two rows have, where it is one that is there twice."""

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]


def count_on(stamps: Floats, origin: float, notes: list[str]) -> Floats:
    """Return the stamps with every change of summer time taken back.

    A step back or forth counts as one when it is of an hour and stands alone, or when it is of
    about an hour in a night in which clocks are set: some rows may be missing there. A logger that
    stood still for just this hour looks the same: then its gap goes unnoticed.

    Args:
        stamps: local times in seconds since ``origin`` in the order of the rows, shape ``(n,)``.
        origin: seconds since 1970 as if the time were UTC.
        notes: what was done is added.
    """
    steps = np.diff(stamps)
    forth = steps[steps > 0.0]
    if forth.size == 0 or (period := float(np.median(forth))) > 0.5 * _HOUR:
        return stamps

    def is_change(row: int, excess: float, *, is_alone: bool) -> bool:
        """Whether a clock was set before a row; ``excess`` is the interval without the hour."""
        if is_alone and 0.0 < excess <= 1.5 * period:
            return True
        return 0.0 < excess <= 0.5 * _HOUR and _is_night_of_change(origin + stamps[row])

    back = (np.flatnonzero(steps < 0.0) + 1).tolist()
    long = (np.flatnonzero(steps > 0.5 * _HOUR) + 1).tolist()
    moved = np.zeros(stamps.size)
    if all(is_change(row, steps[row - 1] + _HOUR, is_alone=len(back) == 1) for row in back):
        for row in back:
            moved[row:] += _HOUR
            notes.append(
                f"from row {row + 1} on the local time is an hour less (end of summer time): "
                "the times are counted on"
            )
    for row in long:
        excess = steps[row - 1] - _HOUR
        # The hour that is not there is a full one of the clock.
        lacks_hour = (origin + stamps[row]) % _HOUR < excess
        if lacks_hour and is_change(row, excess, is_alone=len(long) == 1):
            moved[row:] -= _HOUR
            notes.append(
                f"from row {row + 1} on the local time is an hour more (summer time): taken back"
            )
    return stamps + moved


def leave_out_mixed_hours(stamps: Floats, origin: float, notes: list[str]) -> tuple[Rows, Floats]:
    """Return which rows to keep, and their stamps: an hour whose rows are mixed with others is not.

    Args:
        stamps: local times in seconds since ``origin``, sorted, shape ``(n,)``.
        origin: seconds since 1970 as if the time were UTC.
        notes: what was done is added.
    """
    keep = np.ones(stamps.size, dtype=np.bool_)
    moved = np.zeros(stamps.size)
    hours = np.floor((origin + stamps) / _HOUR)
    twice = np.flatnonzero(np.diff(stamps) == 0.0)
    for hour in np.unique(hours[twice]).tolist():
        if not _is_night_of_change(hour * _HOUR):
            continue
        begin, end = np.searchsorted(hours, [hour, hour + 1.0]).tolist()
        _, counts = np.unique(stamps[begin:end], return_counts=True)
        before = np.unique(stamps[hours == hour - 1.0]).size
        is_whole = counts.size >= _MIXED * before > 0
        if is_whole and np.count_nonzero(counts == 2) >= _MIXED * counts.size:
            keep[begin:end] = False
            moved[end:] += _HOUR
            notes.append(
                f"{end - begin} rows of the hour that the end of summer time repeats are mixed and "
                "left out; export it in UTC, or unsorted"
            )
    kept = np.flatnonzero(keep)
    return kept, (stamps + moved)[kept]


def _is_night_of_change(local: float) -> bool:
    """Whether clocks may be set at a local time, seconds since 1970 as if it were UTC."""
    moment = datetime.fromtimestamp(local, UTC)
    if moment.weekday() != 6 or moment.hour >= _UNTIL:
        return False
    return any(first <= moment.day < first + 7 for first in _SUNDAYS.get(moment.month, ()))
