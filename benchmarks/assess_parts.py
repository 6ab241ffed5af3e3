"""Where the time of a window goes in `fieldlink assess`. For `benchmarks.assess_fleet`."""

from __future__ import annotations

import time
from pathlib import Path
from types import SimpleNamespace

from benchmarks.assess_runs import write_fleet
from estimator import identify
from fieldlink.assess.causes import cause_of
from fieldlink.assess.job import Columns, Cut, Piece
from fieldlink.assess.readers.parquet_recordings import parquet_windows

__all__ = ["measure_parts"]

DAY = 86_400.0


def measure_parts(folder: Path, windows: int, samples: int, days: int) -> list[list[object]]:
    """Judge windows in this process; a row for each part: processor ms a window, and its share.

    Args:
        folder: an empty one, for the fleet.
        windows: to judge.
        samples: of a window.
        days: windows of a loop.
    """
    write_fleet(folder, windows, samples, days)
    job = SimpleNamespace(cut=Cut(every=DAY, samples=samples), columns=Columns())
    files = sorted(folder.glob("*.parquet"))
    _judge(files[:1], job)  # kernels and imports
    spent = _judge(files, job)
    whole = sum(spent.values())
    return [
        [part, 1000.0 * seconds / windows, 100.0 * seconds / whole]
        for part, seconds in spent.items()
    ]


def _judge(files: list[Path], job: SimpleNamespace) -> dict[str, float]:
    spent = {"reading and cutting": 0.0, "the estimator": 0.0, "cause and next step": 0.0}
    for file in files:
        moments = [time.process_time()]
        windows = list(parquet_windows(job, Piece(0, file.name, str(file))))  # type: ignore[arg-type]
        moments.append(time.process_time())
        spent["reading and cutting"] += moments[1] - moments[0]
        for _, window in windows:
            begun = time.process_time()
            result = identify(window.op, window.pv, sp=window.sp, period=window.period)
            judged = time.process_time()
            cause_of(result, window)
            spent["the estimator"] += judged - begun
            spent["cause and next step"] += time.process_time() - judged
    return spent
