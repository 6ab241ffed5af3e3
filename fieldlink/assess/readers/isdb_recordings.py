"""The International Stiction Data Base as a MATLAB file, a loop a piece."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fieldlink.assess.cutting import MIN_ROWS, cut_windows
from fieldlink.assess.errors import ReadingError
from fieldlink.assess.job import Job, Piece
from fieldlink.assess.readers.base import Named
from fieldlink.assess.readers.isdb import isdb_loops, read_isdb
from fieldlink.assess.series import Recorded, Series

__all__ = ["isdb_pieces", "isdb_windows"]


def isdb_pieces(job: Job, piece: Piece) -> Iterator[Piece]:
    """List the loops of the file."""
    del job
    for name in isdb_loops(piece.path):
        yield Piece(piece.place, piece.file, piece.path, name)


def isdb_windows(job: Job, piece: Piece) -> Iterator[Named]:
    """Read one loop and cut it into windows."""
    if not piece.loop:
        # The loops could not be listed: reading them again says why.
        count = len(isdb_loops(piece.path))
        raise ReadingError(f"could not be read before, now it has {count} loops; assess it again")
    loop = read_isdb(piece.path, piece.loop)
    if loop.op.size < MIN_ROWS:
        raise ReadingError(f"has {loop.op.size} samples, at least {MIN_ROWS} are needed")
    period = job.columns.period or loop.period_s or 1.0
    series = Series(
        time=np.arange(loop.op.size, dtype=np.float64) * period,
        op=loop.op,
        pv=loop.pv,
        sp=loop.sp,
        auto=None,
        period=period,
        dated=False,
    )
    for window in cut_windows(Recorded(series), piece, job.cut):
        yield piece.loop, window
