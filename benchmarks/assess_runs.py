"""Running `fieldlink assess` as a user does, in processes of its own, and measuring it.

Made-up fleets for it, and what `benchmarks.assess_fleet` and `benchmarks.dask_overhead` share.
"""

from __future__ import annotations

import csv
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.families.tuning import draw

__all__ = ["AssessCommand", "Run", "read_rows", "run_assess", "write_fleet"]

KINDS = ("pi", "integrating", "oscillatory")
"""Kinds of loops of the tuning family, sticky and healthy in turn."""

DRAWN = 60
"""Different loops that are simulated; more windows are these with noise of their own."""

BEGIN = 1_767_225_600
"""2026-01-01T00:00:00Z."""


@dataclass(frozen=True, slots=True)
class Run:
    """One run of the command.

    Attributes:
        name: what was run.
        windows, errors: rows of the table.
        seconds: wall clock, from start to end of the command.
        cpu: processor seconds of all its processes.
        megabytes: the most that all processes had at a time.
        memory: every half second, in megabytes.
    """

    name: str
    windows: int
    errors: int
    seconds: float
    cpu: float
    megabytes: float
    memory: tuple[float, ...]


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


def read_rows(out: Path) -> list[list[str]]:
    """The table without the column of seconds."""
    with (out / "loops.csv").open(newline="") as stream:
        rows = list(csv.reader(stream))
    seconds = rows[0].index("seconds")
    return [[cell for number, cell in enumerate(row) if number != seconds] for row in rows]


class AssessCommand:
    """The command in a process of its own, with its memory over time."""

    def __init__(self, fleet: Path, out: Path, samples: int, *options: str) -> None:
        self.begun = time.perf_counter()
        self.out = out
        self.memory: list[float] = []
        self._cpu: dict[int, float] = {}
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "fieldlink.cli", "assess", str(fleet), "--out", str(out)),
                *("--every", "1d", "--samples", str(samples), *options),
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._said: list[str] = []
        self._threads = [
            threading.Thread(target=work, daemon=True) for work in (self._listen, self._watch)
        ]
        self.first_rows = threading.Event()
        for thread in self._threads:
            thread.start()

    def children(self, name: str = "fieldlink.assess.workers.worker") -> list[psutil.Process]:
        """Processes below the command whose command line holds a name."""
        found = []
        try:
            below = psutil.Process(self.process.pid).children(recursive=True)
        except psutil.NoSuchProcess:
            return []
        for one in below:
            try:
                if name in " ".join(one.cmdline()):
                    found.append(one)
            except psutil.Error:
                continue
        return found

    @property
    def cpu(self) -> float:
        """Processor seconds of the command and of all processes below it, up to the last look."""
        return sum(self._cpu.values())

    def wait(self) -> tuple[int, float, str]:
        """Exit status, seconds, and what it said."""
        self.process.wait()
        seconds = time.perf_counter() - self.begun
        for thread in self._threads:
            thread.join()
        return self.process.returncode, seconds, "".join(self._said)

    def _listen(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self._said.append(line)
            if " read: " in line:
                self.first_rows.set()
        self.first_rows.set()

    def _watch(self) -> None:
        while self.process.poll() is None:
            total = 0
            try:
                own = psutil.Process(self.process.pid)
                everyone = [own, *own.children(recursive=True)]
            except psutil.NoSuchProcess:
                return
            for one in everyone:
                try:
                    total += one.memory_full_info().pss
                    self._cpu[one.pid] = sum(one.cpu_times()[:2])
                except psutil.Error:
                    continue
            self.memory.append(total / 1e6)
            time.sleep(0.5)


def run_assess(name: str, fleet: Path, out: Path, samples: int, *options: str) -> Run:
    command = AssessCommand(fleet, out, samples, *options)
    status, seconds, said = command.wait()
    if status not in (0, 1):
        raise RuntimeError(f"{name}: exit status {status}: {said}")
    rows = read_rows(out)
    errors = sum(row[-1] != "" for row in rows[1:])
    return Run(
        name,
        len(rows) - 1,
        errors,
        seconds,
        command.cpu,
        max(command.memory),
        tuple(command.memory),
    )
