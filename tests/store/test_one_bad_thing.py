"""One bad row, one wrong address or one damaged page costs that and no more, and is told."""

from __future__ import annotations

import json
import os
import random
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
import structlog

from fieldlink.store import (
    EventRecord,
    Historian,
    HistorianSettings,
    SampleRecord,
    StoreError,
    StoreReport,
    read_events,
    read_samples,
)
from fieldlink.store.wal import find_log_damage

NOON_MS = 1_795_262_400_000
OPENED = EventRecord(NOON_MS, "start", "daemon", "started")
QUICK = HistorianSettings(linger=0.01, retry=0.01, busy_timeout=0.05, flush=60.0)


def sample(slot: int) -> SampleRecord:
    return SampleRecord("FC101", NOON_MS + 1000 * (slot % 1000), slot, 1.0, 2.0, None, True, 0)


def wait_for_losses(historian: Historian, dropped: int) -> StoreReport:
    until = time.monotonic() + 60.0
    while historian.report().dropped < dropped:
        assert time.monotonic() < until, historian.report()
        time.sleep(0.005)
    return historian.report()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "history.sqlite"


def test_rows_that_no_database_can_hold_cost_themselves_only(file: Path) -> None:
    url = f"sqlite:///{file}"
    with structlog.testing.capture_logs() as logs:
        historian = Historian(url, QUICK)
        historian.start(OPENED)
        for slot in (0, 2**63, 1, 2**70, 2):
            historian.put(sample(slot))
        wait_for_losses(historian, 2)
        assert historian.alive
        report = historian.stop()
    assert (report.dropped, report.failing) == (2, False)
    assert read_samples(url)["slot"].tolist() == [0, 1, 2]
    # Each cause is told once, in the log and in the store.
    assert len([line for line in logs if line["event"] == "store.refused"]) == 1
    told = read_events(url)
    assert told["kind"].tolist() == ["start", "store.refused"]
    assert "a row of samples is refused" in told["message"].iloc[-1]


def test_a_table_that_is_gone_is_told_and_not_waited_for(file: Path) -> None:
    url = f"sqlite:///{file}"
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    with closing(sqlite3.connect(file)) as other:
        other.execute("DROP TABLE samples")
        other.commit()
    for slot in range(5):
        historian.put(sample(slot))
    report = wait_for_losses(historian, 5)
    assert (report.dropped, report.retries) == (5, 0)
    assert "no such table: samples" in report.last_error
    historian.stop()
    # What has a table still goes into it.
    assert "store.refused" in read_events(url)["kind"].tolist()


def test_a_later_schema_in_the_place_of_ours_is_not_tried_for_ever(file: Path) -> None:
    other = file.with_name("other.sqlite")
    made = Historian(f"sqlite:///{other}", QUICK)
    made.start(OPENED)
    made.stop()
    with closing(sqlite3.connect(other)) as connection:
        connection.execute("UPDATE meta SET value = '99'")
        connection.execute("PRAGMA journal_mode=DELETE")
        connection.commit()
    before = other.read_bytes()
    with structlog.testing.capture_logs() as logs:
        historian = Historian(f"sqlite:///{file}", replace(QUICK, patience=0.1))
        historian.start(OPENED)
        other.replace(file)
        historian.put(sample(0))
        report = wait_for_losses(historian, 1)
        assert (report.dropped, report.failing) == (1, True)
        assert "schema 99" in report.last_error
        historian.put(sample(1))
        wait_for_losses(historian, 2)
        assert historian.stop().dropped == 2
    assert file.read_bytes() == before
    assert len([line for line in logs if line["event"] == "store.refused"]) == 1


def test_another_programs_database_is_refused_untouched(file: Path) -> None:
    with closing(sqlite3.connect(file)) as connection:
        connection.execute("CREATE TABLE orders (number INTEGER, customer TEXT)")
        connection.execute("CREATE TABLE events (at TEXT, what TEXT)")
        connection.commit()
    before = file.read_bytes()
    with pytest.raises(StoreError, match=r"another program \(tables events, orders\)"):
        Historian(f"sqlite:///{file}", QUICK).start(OPENED)
    with pytest.raises(StoreError, match="Fieldlink historian"):
        read_samples(f"sqlite:///{file}")
    assert file.read_bytes() == before
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_a_historian_that_a_kill_left_without_its_version_goes_on(file: Path) -> None:
    url = f"sqlite:///{file}"
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    historian.stop()
    with closing(sqlite3.connect(file)) as connection:
        connection.execute("DELETE FROM meta")
        connection.execute("DROP TABLE events")
        connection.commit()
    again = Historian(url, QUICK)
    again.start(OPENED)
    again.put(sample(0))
    assert again.stop().dropped == 0
    assert len(read_samples(url)) == 1


KILLED = """
import json, os, sys
from fieldlink.store import EventRecord, Historian, HistorianSettings, SampleRecord

historian = Historian(f"sqlite:///{sys.argv[1]}", HistorianSettings(linger=0.001, batch=5))
historian.start(EventRecord(0, "start", "daemon", "started"))
for slot in range(300):
    historian.put(SampleRecord("FC101", slot, slot, 1.0, 2.0, None, True, 0), wait=True)
while historian.report().written < 301:
    pass
print(json.dumps(historian.report().written))
sys.stdout.flush()
os._exit(9)
"""


@pytest.fixture
def killed(file: Path) -> Path:
    """A historian whose 300 samples are all in the write-ahead log, as a kill leaves it."""
    command = [sys.executable, "-c", KILLED, str(file)]
    root = Path(__file__).parents[2]
    result = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(root)},
    )
    assert (result.returncode, json.loads(result.stdout)) == (9, 301), result.stderr
    return file


def rows_of(database: bytes, log: bytes, folder: Path) -> int:
    """What SQLite itself makes of a file and its log; -1 where the table is lost, too."""
    copy = folder / "copy.sqlite"
    copy.write_bytes(database)
    copy.with_name("copy.sqlite-wal").write_bytes(log)
    try:
        with closing(sqlite3.connect(copy)) as connection:
            return int(connection.execute("SELECT count(*) FROM samples").fetchone()[0])
    except sqlite3.DatabaseError:
        return -1
    finally:
        for path in folder.glob("copy.sqlite*"):
            path.unlink()


def test_damage_of_the_log_is_found_where_sqlite_drops_rows(killed: Path, tmp_path: Path) -> None:
    log = killed.with_name("history.sqlite-wal")
    database, sound = killed.read_bytes(), log.read_bytes()
    assert find_log_damage(log) is None
    assert rows_of(database, sound, tmp_path) == 300
    rng = random.Random(15)
    places = [0, 9, 17, 25, 32, 40, 45, 60, *(rng.randrange(len(sound)) for _ in range(30))]
    for place in places:
        damaged = bytearray(sound)
        damaged[place] ^= 1 << rng.randrange(8)
        log.write_bytes(damaged)
        dropped = rows_of(database, bytes(damaged), tmp_path) != 300
        found = find_log_damage(log)
        # Some header fields matter to nobody: SQLite checks them all the same.
        assert (found is not None) >= dropped, f"byte {place}"
        assert found is None or 0 < found.lost <= found.frames
    for length in (0, 10, 32, 5000):
        log.write_bytes(sound[:length])
        assert find_log_damage(log) is None


def test_rows_lost_with_a_damaged_log_are_told(killed: Path) -> None:
    log = killed.with_name("history.sqlite-wal")
    damaged = bytearray(log.read_bytes())
    damaged[len(damaged) // 2] ^= 0x10
    log.write_bytes(damaged)
    url = f"sqlite:///{killed}"
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    historian.put(sample(1000))
    historian.stop()
    assert 0 < len(read_samples(url)) < 300
    told = read_events(url).set_index("kind")["message"]
    assert "pages cannot be read" in told["store.log_damaged"]
    kept = list(killed.parent.glob("history.sqlite-wal.damaged-*"))
    assert [path.read_bytes() for path in kept] == [bytes(damaged)]
    assert kept[0].name in told["store.log_damaged"]


def test_a_log_as_a_kill_leaves_it_is_no_event(killed: Path) -> None:
    url = f"sqlite:///{killed}"
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    historian.stop()
    assert read_events(url)["kind"].tolist() == ["start", "start"]
    assert len(read_samples(url)) == 300
