"""A damaged historian is set aside under a dated name, and a new one takes its place."""

from __future__ import annotations

import os
import sqlite3
import time
from contextlib import closing
from pathlib import Path

import pytest

from fieldlink.store import (
    EventRecord,
    Historian,
    HistorianSettings,
    SampleRecord,
    StoreError,
    database,
    read_events,
    read_samples,
)

OPENED = EventRecord(1_795_262_400_000, "start", "daemon", "started")
QUICK = HistorianSettings(linger=0.01, retry=0.02, busy_timeout=0.05, flush=60.0)


def sample(slot: int) -> SampleRecord:
    return SampleRecord("FC101", 1_795_262_400_000 + 1000 * slot, slot, 1.0, 2.0, None, None, 0)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "history.sqlite"


def fill(file: Path, samples: int = 3000) -> None:
    historian = Historian(f"sqlite:///{file}", QUICK)
    historian.start(OPENED)
    for slot in range(samples):
        historian.put(sample(slot))
    historian.stop()


def set_aside(file: Path) -> list[Path]:
    return sorted(file.parent.glob("history.damaged-*.sqlite"))


def scribble(file: Path, at: int, length: int, byte: bytes = b"\xa5") -> None:
    with file.open("r+b") as stream:
        stream.seek(at)
        stream.write(byte * length)


@pytest.mark.parametrize(("at", "length", "byte"), [(100, 900, b"\xa5"), (0, 4096, b"\0")])
def test_at_the_start(file: Path, at: int, length: int, byte: bytes) -> None:
    fill(file)
    scribble(file, at, length, byte)
    damaged = file.read_bytes()
    fill(file, samples=5)
    (aside,) = set_aside(file)
    assert aside.read_bytes() == damaged
    url = f"sqlite:///{file}"
    assert len(read_samples(url)) == 5
    events = read_events(url)
    message = events[events["kind"] == "store.set_aside"]["message"].iloc[0]
    assert aside.name in message


def test_while_the_daemon_runs(file: Path) -> None:
    fill(file)
    url = f"sqlite:///{file}"
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    # All but the first page, and the journal that would hide it: the next insert meets the damage.
    scribble(file, 4096, file.stat().st_size - 4096)
    os.truncate(file.with_name(file.name + "-wal"), 0)
    for slot in range(10):
        historian.put(sample(slot))
    while historian.report().written < 12:
        time.sleep(0.01)
    report = historian.stop()
    assert (report.set_aside, report.dropped) == (1, 0)
    assert len(set_aside(file)) == 1
    assert read_samples(url)["slot"].tolist() == list(range(10))
    assert "store.set_aside" in read_events(url)["kind"].tolist()


def test_a_file_of_somebodys_is_left_alone(file: Path) -> None:
    file.write_text("the minutes of a meeting\n" * 100)
    with pytest.raises(StoreError, match=r"not a database; move history\.sqlite away.* backup"):
        Historian(f"sqlite:///{file}", QUICK).start(OPENED)
    assert file.read_text().startswith("the minutes")
    assert set_aside(file) == []


def test_each_cause_for_which_a_store_is_not_read_has_its_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(database, "READERS_PATIENCE", 0.2)
    url = f"sqlite:///{tmp_path}/history.sqlite"
    historian = Historian(url)
    historian.start(OPENED)
    historian.stop()
    with closing(sqlite3.connect(tmp_path / "history.sqlite")) as other:
        other.execute("pragma locking_mode = exclusive")
        other.execute("update events set message = 'x'")
        other.commit()
        with pytest.raises(StoreError, match="database is locked; another program holds it"):
            read_events(url)
    content = bytearray((tmp_path / "history.sqlite").read_bytes())
    content[8192:] = b"\xa5" * len(content[8192:])
    (tmp_path / "history.sqlite").write_bytes(content)
    with pytest.raises(StoreError, match=r"malformed; it is damaged: .* \.recover"):
        read_events(url)
