"""The work list of a fleet: seconds, memory and size of each kind of report.

    python -m benchmarks.work_list                 # 200 loops, a year of daily estimates
    python -m benchmarks.work_list --loops 50 --days 30

A made-up historian (`benchmarks.made_fleet`): six of ten loops have something wrong or were
repaired, each with pictures and a page of its own. Each report is made by the command itself in a
process of its own, start of Python included. "All sick" is the same fleet with no healthy loop.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.made_fleet import KINDS, Fleet, make_fleet
from benchmarks.report import heading, keep, table

ASKED_SECONDS = 30.0
"""What the report of 200 loops may take."""

REPORTS = (
    ("engineer", "html"), ("technician", "html"), ("manager", "html"),
    ("engineer", "pdf"), ("engineer", "csv"), ("engineer", "xlsx"),
)  # fmt: skip
HEADER = ("fleet", "for", "format", "wall s", "core s", "memory MB", "size MB")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.work_list")
    parser.add_argument("--loops", type=int, default=200)
    parser.add_argument("--days", type=int, default=365)
    parser.add_argument("--out", type=Path, default=None)
    given = parser.parse_args(arguments)
    rows: list[tuple[Any, ...]] = []
    with tempfile.TemporaryDirectory() as folder:
        fleet = Fleet(Path(folder) / "fleet.sqlite", given.loops, given.days)
        make_fleet(fleet)
        rows.extend(("mixed", *kind, *_measure(fleet, *kind)) for kind in REPORTS)
        sick = Fleet(Path(folder) / "sick.sqlite", given.loops, given.days)
        make_fleet(sick, kinds=KINDS[:6])
        rows.extend(
            ("all sick", *kind, *_measure(sick, *kind)) for kind in (REPORTS[0], REPORTS[3])
        )
        size = fleet.file.stat().st_size / 1e6
    slowest = max(row[3] for row in rows)
    words = (
        f"{given.loops} loops, {given.days} daily estimates each, historian {size:.0f} MB. The "
        f"slowest took {slowest:.1f} s; {ASKED_SECONDS:g} s are asked for 200 loops."
    )
    text = "\n\n".join([heading("work_list", __doc__, arguments), table(HEADER, rows), words])
    print(text)
    figures = {
        "loops": given.loops,
        "days": given.days,
        "rows": [dict(zip(HEADER, r, strict=True)) for r in rows],
    }
    keep(given.out, "work_list", text, figures)
    return 0


def _measure(fleet: Fleet, audience: str, kind: str) -> tuple[float, float, float, float]:
    """Wall seconds, core seconds, megabytes of memory and megabytes of the file of one report."""
    out = fleet.file.with_name(f"report.{kind}")
    command = [
        sys.executable, "-m", "fieldlink.cli", "report", str(fleet.file),
        "--for", audience, "--out", str(out),
    ]  # fmt: skip
    begin = time.perf_counter()
    process = os.posix_spawn(
        sys.executable, command, os.environ,
        file_actions=[(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)],
    )  # fmt: skip
    _, status, used = os.wait4(process, 0)
    seconds = time.perf_counter() - begin
    if status != 0:
        raise SystemExit(f"{' '.join(command)} ended with status {status}")
    core = used.ru_utime + used.ru_stime
    return seconds, core, used.ru_maxrss / 1024.0, out.stat().st_size / 1e6


if __name__ == "__main__":
    raise SystemExit(main())
