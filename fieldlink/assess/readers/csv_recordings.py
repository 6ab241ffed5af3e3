"""CSV files of every kind that `fieldlink identify` reads, with one loop or several."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fieldlink.assess.cutting import cut_windows
from fieldlink.assess.errors import ReadingError
from fieldlink.assess.histories import named_by_file
from fieldlink.assess.job import Job, Piece
from fieldlink.assess.readers.base import Named
from fieldlink.assess.series import Recorded, Series, runs_in_order
from fieldlink.site.missing_rows import contradicts_clock
from fieldlink.site.recording import Recording, read_recordings

__all__ = ["csv_pieces", "csv_windows"]


def csv_pieces(job: Job, piece: Piece) -> Iterator[Piece]:
    """The file as one piece: what is in it is known when it is read."""
    del job
    yield piece


def csv_windows(job: Job, piece: Piece) -> Iterator[Named]:
    """Read the file and cut its loops into windows."""
    path = Path(piece.path)
    for name, recording in read_recordings(path, job.columns.names(), job.columns.period):
        found = False
        empty: ReadingError | None = None
        for run in runs_in_order(_series(recording)):
            try:
                for window in cut_windows(Recorded(run), piece, job.cut):
                    found = True
                    yield name or named_by_file(path, recording.start), window
            except ReadingError as error:
                # Another part of the recording may hold windows.
                empty = error
        if not found and empty is not None:
            raise empty


def _series(recording: Recording) -> Series:
    rows = np.arange(len(recording), dtype=np.float64)
    seconds = recording.time
    if seconds is None or contradicts_clock(recording):
        seconds = rows * recording.period
    elif np.isnan(seconds).any():
        known = ~np.isnan(seconds)
        seconds = np.interp(rows, rows[known], seconds[known])
    start = recording.start
    return Series(
        time=seconds if start is None else start + seconds,
        op=recording.op,
        pv=recording.pv,
        sp=recording.sp,
        auto=None if recording.auto is None else recording.auto.astype(np.float64),
        period=recording.period,
        dated=start is not None,
        notes=recording.notes,
    )
