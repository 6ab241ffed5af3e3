"""Rows of a recording in the order of time, each moment once.

Historians export newest first, in blocks, with a row twice at the seam of two queries, in local
time over the end of summer time, or with stamps of whole seconds for faster samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.times import NoClockError, Times

__all__ = ["OrderedRows", "Rows", "put_in_order"]

_HOUR = 3600.0
_FEW = 0.05
"""Share of rows with the stamp of another row up to which the stamps count as they are."""

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
        NoClockError: the times name no order: most rows share theirs, or numbers begin again.
    """
    seconds = times.seconds
    known = np.flatnonzero(~np.isnan(seconds))
    steps = np.diff(seconds[known])
    if (steps > 0.0).all():
        back = _before_summer(times, steps) if known.size == seconds.size else None
        rows = np.arange(seconds.size)
        if back is None:
            return OrderedRows(rows, times, ())
        row, stamps = back
        note = f"from row {row + 1} on the local time is an hour more (summer time): taken back"
        return OrderedRows(rows, replace(times, seconds=stamps), (note,))
    if known.size < seconds.size:
        # Without a stamp a row has a place only where the rows stand in the order of time.
        rows, notes = known, [f"{seconds.size - known.size} rows without a time are left out"]
    else:
        rows, notes = np.arange(seconds.size), []
    stamps = seconds[rows]
    if times.is_local and (found := _after_summer(stamps, steps)) is not None:
        row, stamps = found
        notes.append(
            f"from row {row + 1} on the local time is an hour less (end of summer time): "
            "the times are counted on"
        )
    elif (steps < 0.0).any():
        # A stretch that is newest first is turned round, rows of one moment included.
        is_backwards = bool((steps <= 0.0).all())
        order = np.arange(rows.size)[::-1] if is_backwards else np.argsort(stamps, kind="stable")
        if not is_backwards and times.origin is None and not _is_one_clock(stamps):
            row = int(np.flatnonzero(steps < 0.0)[0]) + 1
            raise NoClockError(
                f"the times do not increase: they go back from {stamps[row - 1]:g} to "
                f"{stamps[row]:g} s",
                int(rows[row]),
            )
        rows, stamps = rows[order], stamps[order]
        notes.append(
            "the rows are newest first: turned round"
            if is_backwards
            else f"the rows go back in time {int((steps < 0.0).sum())} times: sorted by time"
        )
    rows, stamps = _without_repetitions(rows, stamps, cells, notes)
    return OrderedRows(rows, replace(times, seconds=stamps), tuple(notes))


def _is_one_clock(stamps: Floats) -> bool:
    """Whether numbers in any order are those of one clock: one that begins again meets its own."""
    steps = np.diff(np.sort(stamps))
    return bool(steps.min() > 0.5 * np.median(steps))


def _before_summer(times: Times, steps: Floats) -> tuple[int, Floats] | None:
    """The only long step of a local time, where it leaves out an hour at a full hour.

    A logger that stood still for just this hour looks the same: then its gap goes unnoticed.
    """
    if not times.is_local or times.origin is None:
        return None
    period = float(np.median(steps))
    long = np.flatnonzero(steps > 0.5 * _HOUR)
    if long.size != 1 or abs(steps[long[0]] - _HOUR - period) > 0.5 * period:
        return None
    row = int(long[0]) + 1
    if (times.origin + times.seconds[row]) % _HOUR >= period:
        return None
    return row, np.concatenate([times.seconds[:row], times.seconds[row:] - _HOUR])


def _after_summer(stamps: Floats, steps: Floats) -> tuple[int, Floats] | None:
    """The only step back, where it is one of an hour, and the stamps counted on over it."""
    back = np.flatnonzero(steps < 0.0)
    forth = steps[steps > 0.0]
    if back.size != 1 or forth.size == 0:
        return None
    row = int(back[0]) + 1
    period = float(np.median(forth))
    if not 0.0 < steps[row - 1] + _HOUR <= 1.5 * period:
        return None
    return row, np.concatenate([stamps[:row], stamps[row:] + _HOUR])


def _without_repetitions(
    rows: Rows, stamps: Floats, cells: Sequence[tuple[str, ...]], notes: list[str]
) -> tuple[Rows, Floats]:
    """Leave out repeated rows; stamps that are coarser than the samples are spread evenly."""
    steps = np.diff(stamps)
    same = np.flatnonzero(steps == 0.0) + 1
    repeated = np.array([n for n in same if cells[rows[n]] == cells[rows[n - 1]]], dtype=np.int64)
    if same.size - repeated.size > _FEW * stamps.size or 2 * same.size > stamps.size:
        return rows, _spread(stamps, notes)
    # Beside an interval of two periods the row is a sample, and its stamp is late or early.
    period = float(np.median(steps[steps > 0.0]))
    wide = np.concatenate([[0.0, 0.0], steps, [math.inf]]) > _TWO * period
    repeated = np.array([n for n in repeated if not (wide[n] or wide[n + 2])], dtype=np.int64)
    if repeated.size:
        notes.append(f"{repeated.size} rows repeat the row before and are left out")
    kept = np.setdiff1d(np.arange(stamps.size), repeated)
    return rows[kept], stamps[kept]


def _spread(stamps: Floats, notes: list[str]) -> Floats:
    """Evenly spaced times, where every stamp is that of its row cut to a coarser clock."""
    changes = np.flatnonzero(np.diff(stamps) > 0.0) + 1
    shared = stamps.size - 1 - changes.size
    refusal = NoClockError(
        f"the times do not increase: {shared} of {stamps.size} rows have the time of the row before"
    )
    if changes.size < 2:
        raise refusal
    first, last = changes[0], changes[-1]
    period = float((stamps[last] - stamps[first]) / (last - first))
    even: Floats = stamps[first] + period * (np.arange(stamps.size) - first)
    clock = float(np.diff(stamps[changes]).min())
    if np.abs(even - stamps).max() > 1.5 * clock + period:
        raise refusal
    notes.append(
        f"{shared} rows have the time of the row before, because the clock counts in steps of "
        f"{clock:g} s: the samples are taken as {period:.4g} s apart"
    )
    return even
