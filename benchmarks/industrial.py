"""Recorded loops beyond their verdicts: the paper's Table 1, one valve over time, collections.

    python -m benchmarks.industrial [--out docs/benchmarks]
    python -m benchmarks.industrial --isdb isdb10.mat --sacac FOLDER

Reads the labelled loops beside the repository (``../shared/data`` or ``--data``), and, where they
are given, the International Stiction Data Base as its one MATLAB file and the SACAC collection as a
folder of CSV files. Verdicts beside labels are in `recorded_loops`. Nothing of the estimator was
chosen by these loops.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.readers import ReaderError, RecordedLoop, isdb_loops, read_isdb, read_sacac
from benchmarks.recorded import DATA, judged, labelled_loops
from benchmarks.report import heading, keep, machine, table
from benchmarks.table1 import CASES, our_rows, table_of
from benchmarks.valve_course import Course, course_of
from estimator import identify, warm_up

__all__ = ["main"]

_CHEM10 = "chemicals.loop10"
"""Name of CHEM 10 in the data base."""


def _table1(loops: dict[str, RecordedLoop], starts: int) -> tuple[str, dict[str, Any]]:
    """The cases of Table 1 whose loop is at hand."""
    parts, figures = [], {}
    for case in CASES:
        loop = loops.get(case.isdb)
        if loop is None:
            parts.append(f"### {case.name}: give the published file, --isdb FILE.mat")
            continue
        rows = our_rows(case, loop.op, loop.pv, starts=starts)
        parts.append(table_of(case, rows))
        figures[case.name] = [asdict(row) for row in rows]
    return "## Table 1 of the paper\n\n" + "\n\n".join(parts), figures


def _read(readers: Sequence[Callable[[], RecordedLoop]]) -> tuple[list[RecordedLoop], list[str]]:
    """The loops that can be read, and why the others cannot: one must not cost the rest."""
    found, complaints = [], []
    for reader in readers:
        try:
            found.append(reader())
        except ReaderError as error:
            complaints.append(str(error))
    return found, complaints


def _unlabelled(title: str, loops: Sequence[RecordedLoop], complaints: Sequence[str]) -> str:
    """What the estimator answers about loops whose files hold no label."""
    header = ("loop", "samples", "verdict", "score", "S", "low", "high", "J", "comment or reason")
    rows = []
    for loop in loops:
        result = identify(loop.op, loop.pv, sp=loop.sp, period=loop.period_s or 1.0)
        s = result.stick_band
        verdict = result.verdict.value + (" (uncertain)" if result.uncertain else "")
        comment = loop.comments or ", ".join(reason.code.value for reason in result.reasons)
        numbers = (result.score, s.value, s.low, s.high, result.slip_jump.value)
        rows.append((loop.name, loop.op.size, verdict, *numbers, comment[:60]))
    unread = "".join(f"\n- not read: {complaint}" for complaint in complaints)
    return f"## {title}\n\n{table(header, rows)}\n{unread}".rstrip()


def _chem10(data: Path) -> dict[str, RecordedLoop]:
    """CHEM 10 from the labelled loops, under the name it has in the data base."""
    windows = [w for w in labelled_loops(data, "isdb") if w.file == "CHEM10.csv"]
    loops = [RecordedLoop(_CHEM10, w.op, w.pv, w.sp, w.period_s, "") for w in windows]
    return {loop.name: loop for loop in loops}


def _longest_course(data: Path) -> tuple[str, Course]:
    """The plant's loop with the most windows, and its valve over time."""
    plant = [window for window in labelled_loops(data, "plant") if window.begun is not None]
    loop = Counter(window.loop for window in plant).most_common(1)[0][0]
    own = judged([window for window in plant if window.loop == loop])
    return loop, course_of([one.window.begun or 0.0 for one in own], [one.result for one in own])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the labelled loops")
    parser.add_argument("--isdb", type=Path, metavar="FILE.mat", help="the published data base")
    parser.add_argument("--sacac", type=Path, metavar="FOLDER", help="the published CSV files")
    parser.add_argument(
        "--starts", type=int, default=7, help="M of the paper's optimisation in Table 1; 0: none"
    )
    parser.add_argument("--out", type=Path, help="folder for industrial.md and industrial.json")
    options = parser.parse_args(arguments)
    if not options.data.is_dir() and options.isdb is None and options.sacac is None:
        print(
            f"no recorded loops at {options.data}: give --data, --isdb or --sacac", file=sys.stderr
        )
        return 2
    warm_up()
    parts = [heading("industrial", __doc__, arguments)]
    figures: dict[str, Any] = {"machine": machine()}
    loops: dict[str, RecordedLoop] = {}
    if options.data.is_dir():
        loop, course = _longest_course(options.data)
        parts.append(f"## S of {loop} over time\n\n{course.markdown()}")
        figures["course"] = {"loop": loop, **course.to_dict()}
        loops |= _chem10(options.data)
    if options.isdb is not None:
        names = isdb_loops(options.isdb)
        every, unread = _read([partial(read_isdb, options.isdb, name) for name in names])
        loops |= {loop.name: loop for loop in every}
        parts.append(_unlabelled(f"All loops of {options.isdb.name}", every, unread))
    if options.sacac is not None:
        files = sorted(options.sacac.glob("*.csv"))
        parts.append(_unlabelled("SACAC", *_read([partial(read_sacac, file) for file in files])))
    text, rows = _table1(loops, options.starts)
    parts.append(text)
    print("\n\n".join(parts))
    keep(options.out, "industrial", "\n\n".join(parts), {**figures, "table1": rows})
    return 0


if __name__ == "__main__":
    sys.exit(main())
