"""What a fleet of loops takes: windows a second, Dask over local, kills, memory, machines.

    python -m benchmarks.assess_fleet [--windows 2000] [--samples 1000] [--out docs/benchmarks]

Windows are simulated loops of the tuning family, sticky and healthy in turn, each in a Parquet file
of its own loop, a window after another. The command `fieldlink assess` is run on them as a user
runs it, in processes of its own, with one and two workers, and on a Dask cluster of this machine
beside the local pool. Processor seconds are those of all its processes: on a machine that does
other things as well, they tell the cost and the wall clock does not. Memory is the sum of the
proportional set sizes of all its processes (a page that several share counts once), every half
second. For the kills, a worker process is killed at random times while the command runs, the
command itself is killed and started again, and so are a Dask worker and the Dask scheduler; the
tables are compared without the column of seconds. The last table is arithmetic on the first.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.assess_runs.command import Run, rows_of, run_assess
from benchmarks.assess_runs.kills import disturb_cluster, kill_command, kill_workers
from benchmarks.assess_runs.parquet_fleet import write_fleet
from benchmarks.report import heading, keep, machine, table

__all__ = ["machines", "main"]

DAYS = 365
TABLES = (10_000, 100_000, 400_000)
"""Rows of the tables that are finished without judging."""
FLEETS = (500, 2_000, 10_000)
CORES = 16
"""Of a machine in the last table."""


def machines(windows_a_second_a_core: float) -> list[tuple[Any, ...]]:
    """The table of fleets: loops, windows of a year, hours of one machine, machines for a night."""
    rows = []
    for loops in FLEETS:
        windows = loops * DAYS
        core_hours = windows / windows_a_second_a_core / 3600.0
        daily = loops / windows_a_second_a_core / CORES
        rows.append(
            (
                loops,
                windows,
                core_hours,
                core_hours / CORES,
                max(1, -(-int(np.ceil(core_hours / CORES)) // 12)),
                daily / 60.0,
            )
        )
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--windows", type=int, default=2000, help="of the timed runs")
    parser.add_argument("--samples", type=int, default=1000, help="of a window")
    parser.add_argument("--days", type=int, default=10, help="windows of a loop")
    parser.add_argument("--kill-windows", type=int, default=200, help="of the runs with kills")
    parser.add_argument("--kills", type=int, default=10, help="of workers; half of the command")
    parser.add_argument("--out", type=Path, help="folder for assess_fleet.md and .json")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="fleet") as name:
        text, figures = _measure(Path(name), options)
    text = "\n\n".join([heading("assess_fleet", __doc__, arguments), text])
    print(text)
    keep(options.out, "assess_fleet", text, figures)
    return 0


def _measure(root: Path, options: argparse.Namespace) -> tuple[str, dict[str, Any]]:
    fleet, small = root / "fleet", root / "small"
    for folder, windows in ((fleet, options.windows), (small, options.kill_windows)):
        folder.mkdir()
        write_fleet(folder, windows, options.samples, options.days)
    plans = [
        ("local, 1 worker", ("--workers", "1")),
        ("local, 2 workers", ("--workers", "2")),
        ("Dask, 2 workers", ("--workers", "2", "--engine", "dask")),
    ]
    runs = [
        run_assess(name, fleet, root / f"run {number}", options.samples, *given)
        for number, (name, given) in enumerate(plans)
    ]
    same = [
        rows_of(root / f"run {number}") == rows_of(root / "run 0") for number in range(len(plans))
    ]
    run_assess("undisturbed", small, root / "whole", options.samples, "--workers", "2")
    whole = rows_of(root / "whole")
    killed: list[tuple[str, int, str]] = []

    def judge(name: str, out: Path, kills: int) -> None:
        killed.append((name, kills, "same" if rows_of(out) == whole else "DIFFERENT"))

    size, kills = options.samples, options.kills
    judge("worker process", root / "k1", kill_workers(small, root / "k1", size, kills))
    judge("command", root / "k2", kill_command(small, root / "k2", size, kills // 2))
    for number, what in enumerate(("Dask worker", "Dask scheduler", "Dask client")):
        out = root / f"k{3 + number}"
        disturb_cluster(small, out, size, what)
        judge(what, out, 1)
    finished = [_finished(rows) for rows in TABLES]
    return _texts(runs, same, killed, finished), {
        "options": {k: v for k, v in vars(options).items() if k != "out"},
        "machine": machine(),
        "runs": [asdict(run) for run in runs],
        "kills": killed,
        "finished": finished,
    }


def _finished(rows: int) -> dict[str, float]:
    """Figures of finishing a table, from a process of its own for its memory."""
    command = [sys.executable, "-m", "benchmarks.finish_table", str(rows)]
    figures: dict[str, float] = json.loads(subprocess.check_output(command))
    return figures


def _texts(
    runs: Sequence[Run],
    same: Sequence[bool],
    killed: Sequence[tuple[Any, ...]],
    finished: Sequence[dict[str, float]],
) -> str:
    cores = [1, 2, 2]
    first = table(
        (
            *("run", "windows", "errors", "seconds", "windows/s", "processor s"),
            *("windows/processor s", "processor s of a core", "most MB", "table"),
        ),
        [
            (
                *(run.name, run.windows, run.errors, run.seconds, run.windows / run.seconds),
                *(run.cpu, run.windows / run.cpu, run.cpu / run.seconds / n, run.megabytes),
                "same" if equal else "DIFFERENT",
            )
            for run, n, equal in zip(runs, cores, same, strict=True)
        ],
    )
    speed = runs[1].windows / runs[1].cpu
    wall, cpu = (
        100.0 * (getattr(runs[2], name) / getattr(runs[1], name) - 1.0)
        for name in ("seconds", "cpu")
    )
    quarters = [
        (run.name, *(float(np.median(part)) for part in np.array_split(np.array(run.memory), 4)))
        for run in runs
    ]
    return "\n\n".join(
        [
            "## Speed",
            first,
            f"Dask over local, both with two workers: {cpu:+.1f} % of the processor seconds, "
            f"{wall:+.1f} % of the wall clock.",
            "## Memory over time, megabytes",
            "Median of each quarter of the run, all processes together:",
            table(("run", "first quarter", "second", "third", "last"), quarters),
            "## Kills",
            table(("what was killed", "times", "table"), killed),
            "## Finishing: ranking, tables, page",
            "Made-up rows; processor seconds, and megabytes of that process:",
            table(
                [name.replace("_", " ") for name in finished[0]],
                [list(one.values()) for one in finished],
            ),
            "## So many loops, so long, so many machines",
            f"From two workers above ({speed:.3g} windows a processor second), one window a loop "
            f"and day, machines of {CORES} such cores that do nothing else:",
            table(
                ("loops", "windows a year", "core hours", "hours on one machine",
                 "machines for half a day", "minutes each day on one machine"),
                machines(speed),
            ),
        ]
    )  # fmt: skip


if __name__ == "__main__":
    raise SystemExit(main())
