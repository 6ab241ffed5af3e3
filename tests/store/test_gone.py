"""A file that is taken away while it is written is noticed, and nothing that waits is lost."""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from fieldlink.store import (
    EventRecord,
    Historian,
    HistorianSettings,
    SampleRecord,
    StoreReport,
    back_up,
    read_events,
    read_samples,
)

OPENED = EventRecord(1_795_262_400_000, "start", "daemon", "started")
QUICK = HistorianSettings(linger=0.01, retry=0.02, busy_timeout=0.05, flush=60.0)


class Running:
    """A historian with ten samples in its file, and what follows."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.url = f"sqlite:///{file}"
        self.historian = Historian(self.url, QUICK)
        self.historian.start(OPENED)
        self.slots = 0
        self.write(10)

    def put(self, samples: int) -> None:
        for slot in range(self.slots, self.slots + samples):
            utc_ms = 1_795_262_400_000 + 1000 * slot
            self.historian.put(SampleRecord("FC101", utc_ms, slot, 1.0, 2.0, None, None, 0))
        self.slots += samples

    def write(self, samples: int) -> None:
        self.put(samples)
        self.wait(lambda report: report.waiting == 0)

    def wait(self, condition: Callable[[StoreReport], bool]) -> None:
        until = time.monotonic() + 60.0
        while not condition(self.historian.report()):
            assert time.monotonic() < until, self.historian.report()
            time.sleep(0.005)


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    made = Running(tmp_path / "data" / "history.sqlite")
    yield made
    made.historian.stop()


def slots(file: Path) -> list[int]:
    return [int(slot) for slot in read_samples(f"sqlite:///{file}")["slot"]]


def delete_file(file: Path) -> None:
    file.unlink()


def delete_folder(file: Path) -> None:
    shutil.rmtree(file.parent)


@pytest.mark.parametrize("delete", [delete_file, delete_folder])
def test_deleted(running: Running, delete: Callable[[Path], None]) -> None:
    delete(running.file)
    running.write(5)
    report = running.historian.stop()
    assert (report.gone, report.dropped, report.failing) == (1, 0, False)
    assert slots(running.file) == [10, 11, 12, 13, 14]
    events = read_events(running.url)
    assert events["kind"].tolist() == ["store.gone"]
    assert "was deleted" in events["message"][0]


def test_moved_away_it_is_complete_and_a_new_one_begins(running: Running, tmp_path: Path) -> None:
    aside = tmp_path / "aside.sqlite"
    running.file.rename(aside)
    running.write(5)
    assert running.historian.stop().gone == 1
    # Its journal was left under the old name: what was in it is in the file itself.
    assert slots(aside)[:10] == list(range(10))
    assert slots(running.file) == [10, 11, 12, 13, 14]


def test_replaced_by_a_backup_it_goes_on_in_that(running: Running, tmp_path: Path) -> None:
    backup = tmp_path / "backup.sqlite"
    back_up(running.url, backup)
    running.write(3)
    backup.replace(running.file)
    running.write(4)
    assert running.historian.stop().gone == 1
    assert slots(running.file) == [*range(10), *range(13, 17)]
    events = read_events(running.url)
    assert set(events["kind"]) == {"start", "store.gone"}
    assert events["message"].str.contains("was replaced").any()


def test_replaced_by_something_else_it_is_left_alone_until_that_is_gone(running: Running) -> None:
    running.file.unlink()
    running.file.write_text("the minutes of a meeting\n" * 100)
    running.put(5)
    running.wait(lambda report: report.failing and report.retries > 1)
    assert running.file.read_text().startswith("the minutes")
    running.file.unlink()
    running.wait(lambda report: report.waiting == 0)
    report = running.historian.stop()
    assert (report.dropped, report.failing) == (0, False)
    assert slots(running.file) == [10, 11, 12, 13, 14]


def test_a_file_system_that_becomes_read_only_is_waited_out(running: Running) -> None:
    """As after an error of the disk: the file is open, and no write to it succeeds any more."""
    # Not the shared memory beside them: the kernel ends a program that writes to such a mapping.
    files = [str(running.file), f"{running.file}-wal"]
    made = shutil.which("chattr") and subprocess.run(["chattr", "+i", *files], check=False)
    if not made or made.returncode:
        pytest.skip("files can be made immutable by root only, and not on every file system")
    try:
        running.put(5)
        running.wait(lambda report: report.failing and report.retries > 1)
    finally:
        subprocess.run(["chattr", "-i", *files], check=True)
    running.wait(lambda report: report.waiting == 0)
    report = running.historian.stop()
    assert (report.gone, report.dropped, report.failing) == (0, 0, False)
    assert slots(running.file) == list(range(15))
