"""Our own store: the historian of a site, in SQLite or PostgreSQL."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing

import numpy as np

from fieldlink.assess.cutting import MIN_ROWS, cut_windows
from fieldlink.assess.job import Job, Piece
from fieldlink.assess.readers.base import PERIOD_ROWS, Named, split_in_time
from fieldlink.assess.series import Series
from fieldlink.store import SampleReader

__all__ = ["HistorianReader", "historian_pieces", "historian_windows"]


class HistorianReader:
    """A place that is the address of a historian."""

    def pieces(self, job: Job, place: int, after: str) -> Iterator[Piece]:
        """List loops, long ones in parts."""
        del after
        where = job.places[place]
        return historian_pieces(job, Piece(place, where.shown), where.where)

    def windows(self, job: Job, piece: Piece) -> Iterator[Named]:
        """Read a loop, a window at a time."""
        return historian_windows(job, piece, job.places[piece.place].where)


def historian_pieces(job: Job, piece: Piece, url: str) -> Iterator[Piece]:
    """List the loops of the historian at ``url``, long ones in parts."""
    with closing(SampleReader(url)) as reader:
        for loop in reader.loops():
            first, last = reader.span(loop)
            stamps = reader.stretch(loop, first, last, PERIOD_ROWS)["utc_ms"]
            period = _period(stamps / 1000.0) or 1.0
            own = Piece(piece.place, piece.file, piece.path, loop)
            yield from split_in_time(own, job.cut, first / 1000.0, last / 1000.0, period)


def historian_windows(job: Job, piece: Piece, url: str) -> Iterator[Named]:
    """Read a loop of the historian at ``url``, a window at a time."""
    with closing(SampleReader(url)) as reader:
        for window in cut_windows(_Loop(reader, piece.loop, job.columns.period), piece, job.cut):
            yield piece.loop, window


class _Loop:
    """A `Stretch` that reads by query."""

    dated = True

    def __init__(self, reader: SampleReader, loop: str, period: float | None) -> None:
        self._reader, self._name = reader, loop
        first, last = reader.span(loop)
        self.first, self.last = first / 1000.0, last / 1000.0
        stamps = reader.stretch(loop, first, last, PERIOD_ROWS)["utc_ms"]
        self._period = period or _period(stamps / 1000.0) or 1.0

    def fetch(self, since: float, until: float, rows: int) -> Series:
        # Seconds as a float are good to a quarter of a microsecond.
        from_ms, to_ms = (math.ceil(round(1000.0 * moment, 2)) for moment in (since, until))
        found = self._reader.stretch(self._name, from_ms, to_ms, rows)
        stamps = found["utc_ms"] / 1000.0
        period = _period(stamps) if stamps.size >= MIN_ROWS else None
        return Series(
            time=stamps,
            op=found["op"],
            pv=found["pv"],
            sp=None if np.isnan(found["sp"]).all() else found["sp"],
            auto=None if np.isnan(found["auto"]).all() else found["auto"],
            period=period or self._period,
            dated=True,
            slot=found["slot"].astype(np.int64),
        )


def _period(stamps: np.typing.NDArray[np.float64]) -> float | None:
    """Seconds between samples, rounded to the milliseconds that the historian keeps."""
    if stamps.size < 2:
        return None
    period = round(float(np.median(np.diff(stamps))), 3)
    return period if period > 0.0 else None
