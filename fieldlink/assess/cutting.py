"""Recordings cut into windows, whatever they are recorded in.

With ``every``, a window begins at ``since`` and every so many seconds after it (without ``since``:
at full multiples in UTC, so that ``1d`` means midnight; in a recording without dates, at its first
sample). Without ``every``, windows follow each other; a long gap ends one, and what remains behind
the last one is joined to it when it is less than half a window.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Protocol

import numpy as np

from fieldlink.assess.errors import ReadingError
from fieldlink.assess.job import Cut, Piece
from fieldlink.assess.series import Series, equally_spaced, steps_of, without_bad_values
from fieldlink.site.recording import MIN_ROWS

__all__ = ["MIN_ROWS", "Stretch", "cut_windows", "starts_from"]

LONGEST_GAP = 0.1
"""Share of a window's samples that may be missing in one place before the window ends there: the
estimator tolerates a fifth of bad samples in all."""


class Stretch(Protocol):
    """One loop's samples, read by time.

    Attributes:
        dated: whether times are seconds since 1970; otherwise since the first sample.
        first, last: times of the first and the last sample.
    """

    dated: bool
    first: float
    last: float

    def fetch(self, since: float, until: float, rows: int) -> Series:
        """At most ``rows`` samples from ``since`` on and before ``until``, in order of time."""
        ...


def cut_windows(stretch: Stretch, piece: Piece, cut: Cut) -> Iterator[Series]:
    """Yield the windows of a piece, equally spaced; none where nothing of it was asked for.

    Raises:
        ReadingError: dates are asked for and the recording has none, or what lies between them is
            too short for a window.
    """
    if not stretch.dated and (cut.since is not None or cut.until is not None):
        raise ReadingError(
            "the recording has no dates, so --since and --until cannot be applied; leave them out"
        )
    if stretch.first >= _or(cut.until, math.inf) or stretch.last < _or(cut.since, -math.inf):
        # Of a folder with a file a day, a week is asked for: the others are no errors.
        return
    since = max(_or(piece.since, -math.inf), _or(cut.since, -math.inf), stretch.first)
    # A thousandth: the last sample is in, and stamps are kept to the millisecond.
    until = min(_or(piece.until, math.inf), _or(cut.until, math.inf), stretch.last + 1e-3)
    found = 0
    if since < until:
        cutter = _following(stretch, since, until, cut.samples)
        if cut.every is not None:
            cutter = _spaced(stretch, since, until, cut)
        for window in cutter:
            found += 1
            yield without_bad_values(window)
    if not found and piece.since is None and piece.until is None:
        where = " between --since and --until" if cut.since or cut.until else ""
        if cut.every is not None:
            where += f" in {cut.every:g} s (--every)"
        raise ReadingError(
            f"holds no {MIN_ROWS} samples in a row{where}; record for longer, or check the times"
        )


def starts_from(cut: Cut, *, dated: bool, first: float) -> float:
    """The moment from which windows are counted, seconds as the recording counts them."""
    if cut.since is not None:
        return cut.since
    if not dated or cut.every is None:
        return first
    return math.floor(first / cut.every) * cut.every


def _or(value: float | None, default: float) -> float:
    return default if value is None else value


def _spaced(stretch: Stretch, since: float, until: float, cut: Cut) -> Iterator[Series]:
    assert cut.every is not None
    anchor = starts_from(cut, dated=stretch.dated, first=stretch.first)
    number = math.floor((since - anchor) / cut.every + 1e-9)
    while (start := anchor + number * cut.every) < until:
        number += 1
        stop = min(start + cut.every, until)
        rows = stretch.fetch(max(start, since), stop, cut.samples)
        if len(rows) >= MIN_ROWS:
            yield equally_spaced(rows, cut.samples)


def _following(stretch: Stretch, since: float, until: float, samples: int) -> Iterator[Series]:
    longest = samples + samples // 2
    while True:
        rows = stretch.fetch(since, until, longest + 1)
        if len(rows) < 2:
            return
        gaps = np.flatnonzero(steps_of(rows) > max(1.0, LONGEST_GAP * samples))
        # Rows up to the first gap, or to the end of what is left.
        unbroken = int(gaps[0]) + 1 if gaps.size else len(rows)
        taken = samples if unbroken > longest else unbroken
        if taken >= MIN_ROWS:
            yield equally_spaced(rows.part(slice(0, taken)), 2 * longest)
        if taken < len(rows):
            since = float(rows.time[taken])
        else:
            # Where moments are held twice, there are fewer rows than were read, and more to come.
            since = float(rows.time[-1]) + 0.5 * rows.period
