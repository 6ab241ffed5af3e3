"""Runs that are disturbed: a worker, the command, a Dask worker or its scheduler is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

import psutil

from benchmarks.assess_runs.command import AssessCommand, expect_table

__all__ = ["disturb_cluster", "kill_command", "kill_workers"]


def kill_workers(fleet: Path, out: Path, samples: int, kills: int, *options: str) -> int:
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
    expect_table(command)
    return killed


def kill_command(fleet: Path, out: Path, samples: int, kills: int, *options: str) -> int:
    """Kill the command itself at random times and start it again; return how often."""
    random = Random(2)
    for _ in range(kills):
        command = AssessCommand(fleet, out, samples, "--workers", "2", *options)
        command.first_rows.wait()
        time.sleep(random.uniform(0.2, 3.0))
        command.process.kill()
        command.wait()
    expect_table(AssessCommand(fleet, out, samples, "--workers", "2", *options))
    return kills


@contextmanager
def dask_cluster() -> Iterator[tuple[str, Callable[[], None], Callable[[], None]]]:
    """A scheduler and two workers in processes of their own: address, and what kills each."""
    dask = str(Path(sys.executable).parent / "dask")
    port = 18_786
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
        # Dask's workers end with their scheduler; a service manager starts both anew.
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


def disturb_cluster(fleet: Path, out: Path, samples: int, what: str) -> None:
    """Run on a cluster and kill a Dask worker, the scheduler or the client once."""
    with dask_cluster() as (address, kill_worker, kill_scheduler):
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
        expect_table(command)
