"""Rows of a recording in the order of time, each moment once.

Historians export newest first, in blocks, with a row twice at the seam of two queries, in local
time over the end of summer time, or with stamps of whole seconds for faster samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.summer_time import count_on, leave_out_mixed_hours
from fieldlink.site.times import NoClockError, Times

__all__ = ["OrderedRows", "Rows", "put_in_order"]

_NEWEST_FIRST = 0.9
"""Share of the steps that go back in a file whose newest row is first; the others are seams."""

_FEW = 0.05
"""Share of rows with the stamp of another row up to which the stamps count as they are."""

_SEAM_ROWS = 2
"""Rows with which a query may reach into the next: the values before and behind its span."""

_A_RECORD = 50
"""Rows on the average between two steps back, from which on they are stretches in the order of
their clock and no rows in any order: what a recording needs."""

_TWO = 1.5
"""Periods from which on an interval is one of two periods."""

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class OrderedRows:
    """The rows to use.

    Attributes:
        rows: indices of the rows to use, in the order of time.
        times: of these rows.
        notes: what was done, in words.
    """

    rows: Rows
    times: Times
    notes: tuple[str, ...]


def put_in_order(times: Times, cells: Sequence[tuple[str, ...]]) -> OrderedRows:
    """Return the rows in the order of their times, each moment once.

    Args:
        times: of the rows as they stand in the file.
        cells: of these rows; a row with all cells of another is a repetition.

    Raises:
        NoClockError: the times name no order: most rows share theirs, numbers begin again, or a
            clock was set back.
    """
    known = np.flatnonzero(~np.isnan(times.seconds))
    steps = np.diff(times.seconds[known])
    notes: list[str] = []
    if known.size < times.seconds.size:
        if (steps > 0.0).all():
            # Where the rows stand in the order of time, one without a stamp has its place too.
            return OrderedRows(np.arange(times.seconds.size), times, ())
        notes.append(f"{times.seconds.size - known.size} rows without a time are left out")
    rows = known
    # First of all, so that a clock that is set goes on as it did.
    if np.count_nonzero(steps < 0.0) > _NEWEST_FIRST * np.count_nonzero(steps):
        rows = rows[::-1]
        notes.append("the rows are newest first: turned round")
    stamps = times.seconds[rows]
    if times.is_local and times.origin is not None:
        stamps = count_on(stamps, times.origin, notes)
    back = np.flatnonzero(np.diff(stamps) < 0.0) + 1
    if back.size:
        if times.origin is None and not _is_one_clock(stamps):
            row = int(back[0])
            raise NoClockError(
                f"the times do not increase: they go back from {stamps[row - 1]:g} to "
                f"{stamps[row]:g} s",
                int(rows[row]),
            )
        order = np.argsort(stamps, kind="stable")
        _refuse_two_clocks(rows, stamps, order, back, cells)
        rows, stamps = rows[order], stamps[order]
        notes.append(f"the rows go back in time {back.size} times: sorted by time")
    if times.is_local and times.origin is not None:
        kept, stamps = leave_out_mixed_hours(stamps, times.origin, notes)
        rows = rows[kept]
    rows, stamps = _without_repetitions(rows, stamps, cells, notes)
    return OrderedRows(rows, replace(times, seconds=stamps), tuple(notes))


def _refuse_two_clocks(
    rows: Rows, stamps: Floats, order: Rows, back: Rows, cells: Sequence[tuple[str, ...]]
) -> None:
    """Refuse stretches that tell the same time of different moments: sorted, they would mix.

    So does a clock that was set back, and a file of two recordings.
    """
    if stamps.size < _A_RECORD * (back.size + 1):
        return
    seen: set[tuple[str, ...]] = set()
    once = []
    for index in order:
        if cells[rows[index]] not in seen:
            seen.add(cells[rows[index]])
            once.append(index)
    stretch = np.searchsorted(back, np.array(once), side="right")
    changes = np.count_nonzero(np.diff(stretch)) - back.size
    steps = np.diff(stamps)
    own = float(np.median(steps[steps > 0.0]))
    if changes > 2 * _SEAM_ROWS * back.size and np.diff(stamps[once]).min() <= 0.5 * own:
        row = int(back[np.argmax(stamps[back - 1] - stamps[back])])
        raise NoClockError(
            f"the clock goes back by {stamps[row - 1] - stamps[row]:g} s, and the times behind it "
            "are those of other rows, too: it was set, or there are two recordings in one file",
            int(rows[row]),
        )


def _is_one_clock(stamps: Floats) -> bool:
    """Whether numbers in any order are those of one clock: one that begins again meets its own."""
    steps = np.diff(np.sort(stamps))
    return bool(steps.min() > 0.5 * np.median(steps))


def _without_repetitions(
    rows: Rows, stamps: Floats, cells: Sequence[tuple[str, ...]], notes: list[str]
) -> tuple[Rows, Floats]:
    """Leave out repeated rows; stamps that are coarser than the samples are spread evenly."""
    steps = np.diff(stamps)
    same = np.flatnonzero(steps == 0.0) + 1
    repeated = np.array([n for n in same if cells[rows[n]] == cells[rows[n - 1]]], dtype=np.int64)
    if same.size == 0:
        return rows, stamps
    if repeated.size == same.size and 2 * same.size >= stamps.size:
        # A file joined from copies: samples that a coarse clock stamps alike differ here and there.
        notes.append(f"{repeated.size} rows repeat the row before and are left out")
        once = np.setdiff1d(np.arange(stamps.size), repeated)
        return rows[once], stamps[once]
    if same.size - repeated.size > _FEW * stamps.size or 2 * same.size > stamps.size:
        return rows, _spread(stamps, notes)
    # Beside an interval of two periods the row is a sample, and its stamp is late or early.
    period = float(np.median(steps[steps > 0.0]))
    wide = np.concatenate([[0.0, 0.0], steps, [math.inf]]) > _TWO * period
    narrow = same[~(wide[same] | wide[same + 2])]
    repeated = np.intersect1d(repeated, narrow)
    if repeated.size:
        notes.append(f"{repeated.size} rows repeat the row before and are left out")
    replaced = np.setdiff1d(narrow, repeated)
    if replaced.size >= 3 and np.ptp(np.diff(replaced)) <= 2:
        # Every so often a row more than the clock has stamps: the samples come a little faster.
        replaced = replaced[:0]
    if replaced.size:
        notes.append(
            "1 row has the time of the row after it and is left out"
            if replaced.size == 1
            else f"{replaced.size} rows have the time of the row after them and are left out"
        )
    kept = np.setdiff1d(np.arange(stamps.size), [*repeated, *(replaced - 1)])
    return rows[kept], stamps[kept]


def _spread(stamps: Floats, notes: list[str]) -> Floats:
    """Evenly spaced times, where every stamp is that of its row cut to a coarser clock.

    Every count of the clock has a row then; where counts are left out, rows are missing.
    """
    steps = np.diff(stamps)
    changes = np.flatnonzero(steps > 0.0) + 1
    shared = stamps.size - 1 - changes.size
    refusal = NoClockError(
        f"the times do not increase: {shared} of {stamps.size} rows have the time of the row before"
    )
    if changes.size < 2:
        raise refusal
    clock = float(steps[changes - 1].min())
    gaps = changes[steps[changes - 1] > _TWO * clock]
    if gaps.size > _FEW * changes.size:
        gaps = gaps[:0]
    bounds = [0, *gaps.tolist(), stamps.size]
    parts = [
        changes[(changes > first) & (changes < last)] if gaps.size else changes
        for first, last in pairwise(bounds)
    ]
    long_ones = [part for part in parts if part.size > 1]
    counted = sum(int(part[-1] - part[0]) for part in long_ones)
    if not counted:
        raise refusal
    period = float(sum(stamps[part[-1]] - stamps[part[0]] for part in long_ones) / counted)
    even = np.empty_like(stamps)
    for first, last, part in zip(bounds[:-1], bounds[1:], parts, strict=True):
        anchor = int(part[0]) if part.size else first
        even[first:last] = stamps[anchor] + period * (np.arange(first, last) - anchor)
    if np.abs(even - stamps).max() > 1.5 * clock + period or (np.diff(even) <= 0.0).any():
        raise refusal
    notes.append(
        f"{shared} rows have the time of the row before, because the clock counts in steps of "
        f"{clock:g} s: the samples are taken as {period:.4g} s apart"
    )
    return even
