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
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import psutil

from benchmarks.assess_parts import measure_parts
from benchmarks.assess_runs import AssessCommand, Run, read_rows, run_assess, write_fleet
from benchmarks.report import heading, keep, machine, table

__all__ = ["machines", "main"]

DAYS = 365
TABLES = (10_000, 100_000, 400_000)
"""Rows of the tables that are finished without judging."""
PARTS = 40
"""Windows judged in one process, to see where their time goes."""
FLEETS = (500, 2_000, 10_000)
CORES = 16
"""Of a machine in the last table."""


def _kill_workers(fleet: Path, out: Path, samples: int, kills: int, *options: str) -> int:
    """Kill a worker at random times; return how many were killed."""
    random = Random(1)
    command = AssessCommand(fleet, out, samples, "--workers", "2", *options)
    command.first_rows.wait()
    killed = 0
    while killed < kills and command.process.poll() is None:
        time.sleep(random.uniform(0.2, 3.0))
        workers = command.children()
        if workers:
            random.choice(workers).kill()
            killed += 1
    _expect(command)
    return killed


def _kill_command(fleet: Path, out: Path, samples: int, kills: int, *options: str) -> int:
    """Kill the command itself at random times and start it again; return how often."""
    random = Random(2)
    for _ in range(kills):
        command = AssessCommand(fleet, out, samples, "--workers", "2", *options)
        command.first_rows.wait()
        time.sleep(random.uniform(0.2, 3.0))
        command.process.kill()
        command.wait()
    _expect(AssessCommand(fleet, out, samples, "--workers", "2", *options))
    return kills


@contextmanager
def _cluster() -> Iterator[tuple[str, Callable[[], None], Callable[[], None]]]:
    """Start a scheduler and two workers as processes; return its address and how to kill each."""
    dask = str(Path(sys.executable).parent / "dask")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    running: dict[str, subprocess.Popen[bytes]] = {}
    everything: list[subprocess.Popen[bytes]] = []

    def start(name: str, *arguments: str) -> None:
        running[name] = subprocess.Popen(
            [dask, *arguments, "--no-dashboard"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        everything.append(running[name])

    def start_scheduler() -> None:
        start("scheduler", "scheduler", "--host", "127.0.0.1", "--port", str(port))

    def start_workers() -> None:
        for number in (1, 2):
            start(f"worker {number}", "worker", address, "--nthreads", "1", "--host", "127.0.0.1")

    def kill_scheduler() -> None:
        running["scheduler"].kill()
        running["scheduler"].wait()
        # Dask's workers end with their scheduler; a service manager starts both again.
        start_scheduler()
        start_workers()

    def kill_worker() -> None:
        for one in psutil.Process(running["worker 1"].pid).children():
            one.kill()

    start_scheduler()
    start_workers()
    try:
        yield address, kill_worker, kill_scheduler
    finally:
        for one in everything:
            if one.poll() is None:
                os.killpg(one.pid, signal.SIGTERM)
        for one in everything:
            one.wait()


def _expect(command: AssessCommand) -> None:
    status, _, said = command.wait()
    # A defect ends with 1 as well, but without a table.
    if status not in (0, 1) or not (command.out / "loops.csv").is_file():
        raise RuntimeError(f"exit status {status}: {said}")


def _disturbed_cluster(fleet: Path, out: Path, samples: int, what: str) -> None:
    """Run on a cluster and kill a Dask worker, the scheduler or the client once."""
    with _cluster() as (address, kill_worker, kill_scheduler):
        command = AssessCommand(fleet, out, samples, "--scheduler", address)
        command.first_rows.wait()
        if what == "Dask worker":
            kill_worker()
        elif what == "Dask scheduler":
            kill_scheduler()
        else:
            command.process.kill()
            command.wait()
            command = AssessCommand(fleet, out, samples, "--scheduler", address)
        _expect(command)


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
    parser.add_argument("--windows", type=int, default=2000, help="windows of the timed runs")
    parser.add_argument("--samples", type=int, default=1000, help="samples of a window")
    parser.add_argument(
        "--days", type=int, default=10, help="days, with a window of each loop every day"
    )
    parser.add_argument(
        "--kill-windows", type=int, default=200, help="windows of the runs with kills"
    )
    parser.add_argument(
        "--kills",
        type=int,
        default=10,
        help="kills of workers; the command is killed half as often",
    )
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
        read_rows(root / f"run {number}") == read_rows(root / "run 0")
        for number in range(len(plans))
    ]
    run_assess("undisturbed", small, root / "whole", options.samples, "--workers", "2")
    whole = read_rows(root / "whole")
    killed: list[tuple[str, int, str]] = []

    def judge(name: str, out: Path, kills: int) -> None:
        killed.append((name, kills, "same" if read_rows(out) == whole else "DIFFERENT"))

    size, kills = options.samples, options.kills
    judge("worker process", root / "k1", _kill_workers(small, root / "k1", size, kills))
    judge("command", root / "k2", _kill_command(small, root / "k2", size, kills // 2))
    for number, what in enumerate(("Dask worker", "Dask scheduler", "Dask client")):
        out = root / f"k{3 + number}"
        _disturbed_cluster(small, out, size, what)
        judge(what, out, 1)
    finished = [_finished(rows) for rows in TABLES]
    (root / "parts").mkdir()
    parts = measure_parts(root / "parts", PARTS, options.samples, options.days)
    return _texts(runs, same, killed, finished, parts), {
        "options": {k: v for k, v in vars(options).items() if k != "out"},
        "machine": machine(),
        "runs": [asdict(run) for run in runs],
        "kills": killed,
        "finished": finished,
        "parts": parts,
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
    parts: Sequence[Sequence[object]],
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
            "## Where the time of a window goes",
            f"{PARTS} windows in one process:",
            table(("part", "processor ms a window", "share / %"), parts),
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
