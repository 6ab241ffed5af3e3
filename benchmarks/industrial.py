"""Recorded loops: verdicts beside labels, the paper's Table 1, thresholds and one valve's course.

    python -m benchmarks.industrial [--out docs/benchmarks] [--images docs/images]
    python -m benchmarks.industrial --isdb isdb10.mat --sacac FOLDER

Reads the labelled loops beside the repository (``../shared/data`` or ``--data``) and, for whoever
has them, the International Stiction Data Base as its one MATLAB file and the SACAC collection as a
folder of CSV files.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.labelled_report import labelled_report
from benchmarks.readers import ReaderError, RecordedLoop, isdb_loops, read_isdb, read_sacac
from benchmarks.recorded import DATA, Judged, judged, labelled_loops
from benchmarks.report import heading, keep, machine, table
from benchmarks.roc import plot_roc
from benchmarks.table1 import CASES, our_rows, table_of
from benchmarks.valve_course import course_of, longest_loop, plot_course
from estimator import identify, warm_up

__all__ = ["main"]


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
    """What the estimator says of loops whose files hold no label."""
    header = ("loop", "samples", "verdict", "score", "S", "low", "high", "J", "comment or reason")
    rows = []
    for loop in loops:
        result = identify(loop.op, loop.pv, sp=loop.sp, period=loop.period_s or 1.0)
        s = result.stick_band
        said = loop.comments or ", ".join(reason.code.value for reason in result.reasons)
        rows.append(
            (
                loop.name,
                loop.op.size,
                result.verdict.value,
                result.score,
                *(s.value, s.low, s.high),
                result.slip_jump.value,
                said[:60],
            )
        )
    unread = "".join(f"\n- not read: {complaint}" for complaint in complaints)
    return f"## {title}\n\n{table(header, rows)}\n{unread}".rstrip()


def _chem10(isdb: Sequence[Judged]) -> dict[str, RecordedLoop]:
    """CHEM 10 from the labelled loops, under the name it has in the data base."""
    name = "chemicals.loop10"
    for w in (one.window for one in isdb):
        if w.file == "CHEM10.csv":
            return {name: RecordedLoop(name, w.op, w.pv, None, None, "")}
    return {}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the labelled loops")
    parser.add_argument("--isdb", type=Path, metavar="FILE.mat", help="the published data base")
    parser.add_argument("--sacac", type=Path, metavar="FOLDER", help="the published CSV files")
    parser.add_argument(
        "--starts", type=int, default=7, help="M of the paper's optimisation in Table 1; 0: none"
    )
    parser.add_argument("--images", type=Path, help="folder for roc.png and valve-course.png")
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
        plant = judged(labelled_loops(options.data, "plant"))
        isdb = judged(labelled_loops(options.data, "isdb"))
        report = labelled_report(plant, isdb)
        parts.append(report.text)
        course = course_of(plant, longest_loop(plant))
        parts.append(f"## S of {course.loop} over time\n\n{course.markdown()}")
        figures |= {**report.figures, "course": course.to_dict()}
        loops |= _chem10(isdb)
        if options.images is not None:
            plot_roc(report.curves, options.images / "roc.png")
            plot_course(course, options.images / "valve-course.png")
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
