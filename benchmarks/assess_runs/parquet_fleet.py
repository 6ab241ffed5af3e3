"""A made-up fleet of recordings: simulated loops of the tuning family, a Parquet file a loop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.families.tuning import draw

__all__ = ["write_fleet"]

KINDS = ("pi", "integrating", "oscillatory")
"""Kinds of loops of the tuning family, sticky and healthy in turn."""

DRAWN = 60
"""Different loops that are simulated; more windows are these with noise of their own."""

BEGIN = 1_767_225_600
"""2026-01-01T00:00:00Z."""


def write_fleet(folder: Path, windows: int, samples: int, days: int) -> int:
    """Write ``windows`` daily windows, ``days`` a loop, a Parquet file a loop; return the loops.

    The files hold only the samples of the windows: a day begins, and its window is all there is.
    """
    loops = -(-windows // days)
    drawn = [
        draw(KINDS[number % len(KINDS)], number % 2 == 0, number)
        for number in range(min(DRAWN, loops))
    ]
    left = windows
    for number in range(loops):
        loop = drawn[number % len(drawn)]
        rng = np.random.default_rng(number)
        count = min(days, left)
        left -= count
        op, pv = (np.resize(signal_, samples) for signal_ in (loop.op, loop.pv))
        scale = 1e-3 * float(np.std(pv))
        stamps = (BEGIN + 86_400 * np.arange(count)[:, None] + np.arange(samples)).ravel()
        noisy = np.tile(pv, count) + scale * rng.normal(size=stamps.size)
        pq.write_table(
            pa.table(
                {
                    "time": pa.array(1000 * stamps, pa.timestamp("ms", "UTC")),
                    "op": np.tile(op, count),
                    "pv": noisy,
                }
            ),
            folder / f"L{number:05}.parquet",
            row_group_size=16 * samples,
        )
    return loops
