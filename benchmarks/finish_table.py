"""What finishing a run takes: rows into the run_file, ranked, both tables and the page.

    python -m benchmarks.finish_table ROWS

Rows are made up, 50 a loop; no window is judged. Prints a line of JSON: processor seconds to store
the rows and to finish, the most megabytes of the process, and the size of the files.
"""

from __future__ import annotations

import json
import random
import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fieldlink.assess.job import Job, Piece, Place
from fieldlink.assess.page import write_page
from fieldlink.assess.run_file import RunFile
from fieldlink.assess.table_files import write_tables

__all__ = ["finish", "main"]

WINDOWS = 50
"""Of a loop."""


def _row(loop: int, window: int, draws: random.Random) -> dict[str, Any]:
    sticks = draws.random() < 0.3
    return {
        "file": f"history/L{loop:05}.parquet",
        "loop": f"L{loop:05}",
        "start": f"2026-{1 + window // 28:02}-{1 + window % 28:02}T00:00:00Z",
        "samples": 1000,
        "period_s": 1.0,
        "verdict": "stiction" if sticks else "no_stiction",
        "score": draws.gauss(0.0, 10.0),
        "stick_band": draws.random(),
        "stick_band_low": 0.0,
        "stick_band_high": 1.0,
        "slip_jump": 0.3,
        "cause": "sticky_valve" if sticks else "undetermined",
        "action": "Check the packing, the positioner and the air supply.",
        "seconds": 0.3,
        "error": None,
        "notes": "",
    }


def finish(rows: int, out: Path) -> dict[str, float]:
    """Store ``rows`` rows in a run file in ``out`` and finish; return the figures."""
    draws = random.Random(1)
    job = Job((Place("files", "history", "history"),))
    run_file = RunFile(out / "run.sqlite")
    begun = time.process_time()
    run_file.plan(Piece(0, f"history/L{loop:05}.parquet") for loop in range(rows // WINDOWS))
    after = 0
    while tasks := run_file.tasks(20, after):
        after = tasks[-1].number
        run_file.store(
            [(t.number, [_row(t.number, w, draws) for w in range(WINDOWS)]) for t in tasks]
        )
    stored = time.process_time()
    run_file.index_loops()
    run_file.rank()
    write_tables(run_file, out)
    write_page(run_file, job, run_file.counts(), out / "report.html")
    run_file.close()
    sizes = {path.name: path.stat().st_size / 1e6 for path in out.iterdir()}
    return {
        "rows": rows,
        "seconds_to_store": stored - begun,
        "seconds_to_finish": time.process_time() - stored,
        "megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        "csv_megabytes": sizes["loops.csv"],
        "parquet_megabytes": sizes["loops.parquet"],
        "page_megabytes": sizes["report.html"],
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures."""
    (rows,) = sys.argv[1:] if arguments is None else arguments
    with tempfile.TemporaryDirectory(prefix="fleet") as folder:
        print(json.dumps(finish(int(rows), Path(folder))))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
