"""One run of the command in processes of its own: its table, time, processor and memory."""

from __future__ import annotations

import csv
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

__all__ = ["AssessCommand", "Run", "expect_table", "rows_of", "run_assess"]


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


def rows_of(out: Path) -> list[list[str]]:
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
    rows = rows_of(out)
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


def expect_table(command: AssessCommand) -> None:
    status, _, said = command.wait()
    # A defect ends with 1 as well, but without a table.
    if status not in (0, 1) or not (command.out / "loops.csv").is_file():
        raise RuntimeError(f"exit status {status}: {said}")
