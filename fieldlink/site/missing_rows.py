"""Rows that a recording lacks by its own clock: short gaps become bad samples, long ones cut it.

A logger that stood still leaves no row, and the rows around the gap would count as neighbours.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.recording import PERIODS_DIFFER, Recording
from fieldlink.site.timestamps import typical_interval

__all__ = [
    "LONGEST_FILLED",
    "contradicts_clock",
    "fill_missing_rows",
    "missing_between",
    "put_into_slots",
]

LONGEST_FILLED = 30
"""Missing rows in a gap that are filled with bad samples. Over a longer gap PV forgets what it was:
a judgement looks back 30 rows (`estimator.settings.Modelling.memory`)."""
_LACKS = 0.75
"""Share of a period by which two intervals in a row are too long when a row is missing: a stamp
that is merely late makes the next interval short."""

Floats = NDArray[np.float64]


def fill_missing_rows(recording: Recording) -> Recording:
    """The recording with a bad sample for every missing row.

    Where more than `LONGEST_FILLED` rows in a row are missing, only the longest part between such
    gaps is kept. Without a usable clock, or where a given period contradicts it, nothing changes.
    """
    if recording.time is None or not recording.irregular or len(recording) < 2:
        return recording
    rows = np.arange(len(recording))
    if contradicts_clock(recording):
        return recording
    known = np.flatnonzero(~np.isnan(recording.time))
    steps = np.diff(np.interp(rows, known, recording.time[known]))
    missing = missing_between(steps / recording.period)
    if not missing.any():
        return recording
    edges = np.flatnonzero(missing > LONGEST_FILLED) + 1
    bounds = [0, *edges.tolist(), len(recording)]
    first, last = max(pairwise(bounds), key=lambda part: part[1] - part[0])
    notes = []
    if edges.size:
        longest = float(steps[missing > LONGEST_FILLED].max())
        notes.append(
            f"rows {first + 1} to {last} of {len(recording)} are used, the longest part without a "
            f"long gap (the longest is {longest:g} s); put another part into a file of its own"
        )
        recording = recording.cut(slice(first, last))
    inside = missing[first : last - 1]
    filled = int(inside.sum())
    if filled:
        notes.append(f"{filled} missing rows are taken for bad samples")
    return _spread(recording, inside, (*recording.notes, *notes))


def contradicts_clock(recording: Recording) -> bool:
    """Whether the period was given and is another than that of the recording's own times."""
    if recording.time is None:
        return False
    known = np.flatnonzero(~np.isnan(recording.time))
    own = typical_interval(recording.time[known], known)
    return abs(own / recording.period - 1.0) > PERIODS_DIFFER


def missing_between(intervals: Floats) -> NDArray[np.int64]:
    """Count the samples that are missing between each sample and the next.

    The one rule for every recording with a clock, whatever it is read from.

    Args:
        intervals: from each sample to the next, counted in periods, shape ``(n - 1,)``.
    """
    early = np.concatenate([[1.0], intervals[:-1]])
    late = np.concatenate([intervals[1:], [1.0]])
    lacks = intervals + np.minimum(early, late) - 2.0 >= _LACKS
    found = np.where(lacks, np.rint(intervals) - 1.0, 0.0)
    return np.maximum(found, 0.0).astype(np.int64)


def put_into_slots(values: Floats, slots: NDArray[np.int64]) -> Floats:
    """Put samples into their slots, NaN into the others.

    Args:
        values: samples, shape ``(n,)``.
        slots: their numbers, rising from 0, shape ``(n,)``.

    Returns:
        Shape ``(slots[-1] + 1,)``.
    """
    found = np.full(int(slots[-1]) + 1, np.nan)
    found[slots] = values
    return found


def _spread(recording: Recording, missing: NDArray[np.int64], notes: tuple[str, ...]) -> Recording:
    at = np.concatenate([[0], np.cumsum(missing + 1)])
    size = int(at[-1]) + 1

    auto = None
    if recording.auto is not None:
        # the mode of a missing row is that of the row before
        before = np.searchsorted(at, np.arange(size), side="right") - 1
        auto = recording.auto[before]
    time = recording.time
    if time is not None:
        time = np.interp(np.arange(size), at[~np.isnan(time)], time[~np.isnan(time)])
    return replace(
        recording,
        op=put_into_slots(recording.op, at),
        pv=put_into_slots(recording.pv, at),
        sp=None if recording.sp is None else put_into_slots(recording.sp, at),
        auto=auto,
        time=time,
        notes=notes,
    )
