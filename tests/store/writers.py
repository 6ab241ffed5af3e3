"""Two writers of one historian, on any database: what must hold."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from fieldlink.store import (
    EventRecord,
    Historian,
    HistorianSettings,
    SampleRecord,
    StoreError,
    Writer,
    read_events,
    read_samples,
)

__all__ = [
    "QUICK",
    "begin",
    "kill_a_writer",
    "killed_is_replaced",
    "sample",
    "second_is_refused",
    "sleeper_waits",
    "wait_until",
    "writer",
]

NOON_MS = 1_795_262_400_000
QUICK = HistorianSettings(linger=0.01, retry=0.02, busy_timeout=5.0, beat=0.1, expires=1.0)


def writer(folder: Path, *loops: str, identity: int = 7) -> Writer:
    return Writer(folder, identity, frozenset(loops), NOON_MS, host="edge-7")


def sample(slot: int, loop: str = "FC101") -> SampleRecord:
    return SampleRecord(loop, NOON_MS + 1000 * slot, slot, 1.0, 2.0, None, None, 0)


def begin(url: str, who: Writer, settings: HistorianSettings = QUICK) -> Historian:
    historian = Historian(url, settings)
    historian.start(EventRecord(NOON_MS, "start", str(who.data_dir), "started"), who)
    return historian


def wait_until(condition: Callable[[], bool], within: float = 20.0) -> None:
    until = time.monotonic() + within
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.01)


def second_is_refused(url: str, folder: Path) -> None:
    first = begin(url, writer(folder / "a", "FC101", "TC7"))
    try:
        began = time.monotonic()
        with pytest.raises(StoreError) as refused:
            begin(url, writer(folder / "b", "TC7", "LC3", identity=8))
        # It has seen that the other one lives, and did not wait for its end.
        assert time.monotonic() - began < QUICK.expires
    finally:
        first.stop()
    said = str(refused.value)
    for part in ("loop TC7 ", "host edge-7", str(folder / "a"), "since 2026-11-21 12:00 UTC"):
        assert part in said
    assert "hunter2" not in said
    assert read_events(url)["source"].tolist() == [str(folder / "a")]


def sleeper_waits(url: str, folder: Path) -> None:
    asleep = begin(url, writer(folder / "a", "FC101"), replace(QUICK, beat=1e9))
    second = begin(url, writer(folder / "b", "FC101", identity=8))
    asleep.put(sample(1))
    wait_until(lambda: asleep.report().failing)
    assert f"data_dir {folder / 'b'}" in asleep.report().last_error
    assert len(read_samples(url, "FC101")) == 0
    second.put(sample(2))
    second.stop()
    # The other has left: what waited is written, and nothing of it was lost.
    wait_until(lambda: not asleep.report().failing)
    assert asleep.stop().dropped == 0
    assert read_samples(url, "FC101")["slot"].tolist() == [1, 2]


KILLED = """
import sys, time
from pathlib import Path
from tests.store.writers import begin, writer
begin(sys.argv[1], writer(Path(sys.argv[2]), "FC101"))
print("ready", flush=True)
time.sleep(60)
"""


def kill_a_writer(url: str, folder: Path) -> None:
    root = str(Path(__file__).parents[2])
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, url, str(folder)],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": root},
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        process.send_signal(signal.SIGKILL)


def killed_is_replaced(url: str, folder: Path) -> None:
    """At once by its own data directory, whose lock is free again; after a while by others."""
    for identity, name in ((7, "a"), (8, "b")):
        kill_a_writer(url, folder / "a")
        began = time.monotonic()
        begin(url, writer(folder / name, "FC101", identity=identity)).stop()
        waited = time.monotonic() - began
        assert (waited < QUICK.expires) is (name == "a")
        assert waited < 10 * QUICK.expires
