"""No loop has two writers: the second is refused, a dead one is replaced, nothing interleaves."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from fieldlink.store import read_samples, record_work
from tests.store.writers import (
    QUICK,
    begin,
    killed_is_replaced,
    sample,
    second_is_refused,
    sleeper_waits,
    wait_until,
    writer,
)


@pytest.fixture
def url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path}/history.sqlite"


@pytest.mark.parametrize("check", [second_is_refused, sleeper_waits, killed_is_replaced])
def test_no_loop_has_two_writers(
    check: Callable[[str, Path], None], url: str, tmp_path: Path
) -> None:
    check(url, tmp_path)


def test_writers_of_different_loops_share_a_historian(url: str, tmp_path: Path) -> None:
    first = begin(url, writer(tmp_path / "a", "FC101"))
    second = begin(url, writer(tmp_path / "b", "LC3", identity=8))
    for slot in range(50):
        first.put(sample(slot), wait=True)
        second.put(sample(slot, "LC3"), wait=True)
    assert second.stop().dropped == first.stop().dropped == 0
    assert len(read_samples(url, "FC101")) == len(read_samples(url, "LC3")) == 50


def test_one_that_stopped_leaves_its_loops_to_the_next(url: str, tmp_path: Path) -> None:
    begin(url, writer(tmp_path / "a", "FC101")).stop()
    began = time.monotonic()
    begin(url, writer(tmp_path / "b", "FC101", identity=8)).stop()
    assert time.monotonic() - began < QUICK.expires


def test_loops_that_come_with_a_reload_are_claimed_too(url: str, tmp_path: Path) -> None:
    first = begin(url, writer(tmp_path / "a", "FC101"))
    second = begin(url, writer(tmp_path / "b", "LC3", identity=8))
    second.follow(["LC3", "FC101"])
    second.put(sample(1, "LC3"))
    wait_until(lambda: "loop FC101 " in second.report().last_error)
    second.follow(["LC3"])
    wait_until(lambda: not second.report().failing)
    assert second.stop().dropped == 0
    assert first.report().failing is False
    first.stop()
    assert len(read_samples(url, "LC3")) == 1


def test_work_entered_in_the_writer_s_own_process_leaves_its_log_in_place(
    url: str, tmp_path: Path
) -> None:
    """Another process that reads and leaves must not take the writer for gone."""
    file = tmp_path / "history.sqlite"
    count = "import sqlite3, sys; c = sqlite3.connect(sys.argv[1]); "
    count += "print(c.execute('SELECT count(*) FROM samples').fetchone()[0]); c.close()"

    def seen_elsewhere() -> int:
        read = subprocess.run(
            [sys.executable, "-c", count, str(file)], capture_output=True, text=True, check=True
        )
        return int(read.stdout)

    one = begin(url, writer(tmp_path / "a", "FC101"))
    one.put(sample(1), wait=True)
    wait_until(lambda: one.report().written >= 2)
    record_work(url, "FC101", "done")
    log = file.with_name(f"{file.name}-wal")
    before = log.stat().st_ino
    assert seen_elsewhere() == 1
    assert log.stat().st_ino == before
    one.put(sample(2), wait=True)
    wait_until(lambda: one.report().written >= 3)
    assert seen_elsewhere() == 2
    one.stop()
