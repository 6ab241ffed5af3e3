"""Backups and exports are whole, and made while the historian is written."""

from __future__ import annotations

import json
import shutil
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from fieldlink.cli.app import app
from fieldlink.site.recording import read_recording
from fieldlink.store import (
    EstimateRecord,
    EventRecord,
    Historian,
    HistorianSettings,
    SampleRecord,
    StoreError,
    back_up,
    export,
    read_events,
    read_samples,
)

NOON_MS = 1_795_262_400_000
OPENED = EventRecord(NOON_MS, "start", "daemon", "started")
SITE = """[site]
name = "copies"
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
register_map = "map.csv"
[loops.FC101]
device = "plc"
op = "OP"
pv = "PV"
period = 2.0
"""
MAP = "tag,table,address,type\nOP,holding,0,float32\nPV,holding,2,float32\n"


def sample(slot: int, loop: str = "FC101") -> SampleRecord:
    return SampleRecord(
        loop, NOON_MS + 2000 * slot, slot, 0.1 + slot % 7, 2.0 + slot % 5, None, slot % 2 == 0, 0
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "site.toml").write_text(SITE)
    (tmp_path / "map.csv").write_text(MAP)
    return tmp_path


@pytest.fixture
def url(folder: Path) -> Iterator[str]:
    """A historian with two hundred samples of each of two loops, still being written."""
    url = f"sqlite:///{folder}/data/history.sqlite"
    historian = Historian(url, HistorianSettings(linger=0.001))
    historian.start(OPENED)
    for slot in range(200):
        historian.put(sample(slot), wait=True)
        historian.put(sample(slot, "TC7"), wait=True)
    historian.put(
        EstimateRecord("FC101", NOON_MS, NOON_MS, 0, 9, "estimated", "", document={"a": 1})
    )
    while historian.report().written < 402:
        pass
    ending = threading.Event()

    def go_on() -> None:
        slot = 10_000
        while not ending.wait(0.001):
            historian.put(sample(slot, "BUSY"), wait=True)
            slot += 1

    writer = threading.Thread(target=go_on)
    writer.start()
    try:
        yield url
    finally:
        ending.set()
        writer.join()
        historian.stop()


def run(*arguments: str) -> str:
    result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.usefixtures("url")
def test_a_backup_is_one_moment_and_stands_alone(folder: Path) -> None:
    copy = folder / "copy.sqlite"
    output = run("backup", str(folder / "site.toml"), str(copy))
    assert "checked" in output
    assert [path.name for path in folder.glob("copy.sqlite*")] == ["copy.sqlite"]
    assert copy.stat().st_mode & 0o027 == 0
    with sqlite3.connect(copy) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        slots = [row[0] for row in connection.execute("SELECT slot FROM samples WHERE loop='BUSY'")]
    connection.close()
    assert len(read_samples(f"sqlite:///{copy}", "FC101")) == 200
    # What was written meanwhile is in it up to some moment, without a hole.
    assert slots == list(range(10_000, 10_000 + len(slots)))


def test_a_backup_replaces_nothing_unasked(url: str, folder: Path) -> None:
    copy = folder / "copy.sqlite"
    copy.write_text("dear")
    with pytest.raises(StoreError, match="exists"):
        back_up(url, copy)
    assert copy.read_text() == "dear"
    assert back_up(url, copy, overwrite=True).samples >= 400
    history = folder / "data" / "history.sqlite"
    with pytest.raises(StoreError, match="exists"):
        back_up(url, history, overwrite=True)


def test_a_backup_does_not_wait_for_a_lock_without_end(
    url: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copied = back_up(url, folder / "locked.sqlite").file
    monkeypatch.setattr("fieldlink.store.backup.PATIENCE", 0.1)
    with closing(sqlite3.connect(copied, isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(StoreError, match="database is locked; another program holds it"):
            back_up(f"sqlite:///{copied}", folder / "copy.sqlite")
    assert not (folder / "copy.sqlite").exists()


def test_a_copy_restored_beside_the_log_of_a_killed_daemon_stays_what_it_is(tmp_path: Path) -> None:
    file, copy = tmp_path / "history.sqlite", tmp_path / "copy.sqlite"
    historian = Historian(f"sqlite:///{file}", HistorianSettings(linger=0.01))
    historian.start(OPENED)
    assert back_up(f"sqlite:///{file}", copy).samples == 0
    historian.put(sample(1))
    while historian.report().waiting or historian.report().written < 2:
        time.sleep(0.005)
    # What kill -9 leaves, and the copy put in place of the file alone.
    (tmp_path / "restored").mkdir()
    restored = tmp_path / "restored" / "history.sqlite"
    shutil.copy(copy, restored)
    for part in ("history.sqlite-wal", "history.sqlite-shm"):
        shutil.copy(tmp_path / part, restored.parent)
    historian.stop()
    url = f"sqlite:///{restored}"
    for read in (read_samples, lambda url: back_up(url, tmp_path / "second.sqlite")):
        with pytest.raises(StoreError, match=r"remove history.sqlite-wal and history.sqlite-shm"):
            read(url)
    again = Historian(url)
    again.start(OPENED)
    again.put(sample(2))
    assert again.stop().last_error == ""
    assert read_samples(url)["slot"].tolist() == [2]
    assert read_events(url)["kind"].tolist() == ["start", "start", "store.log_left"]
    assert len(list(restored.parent.glob("history.sqlite-wal.left-*"))) == 1


@pytest.mark.usefixtures("url")
def test_csv_and_parquet_hold_the_same(folder: Path) -> None:
    site = str(folder / "site.toml")
    for name in ("a.csv", "a.parquet"):
        output = run("export", site, "--loop", "FC101", "--out", str(folder / name))
        assert "200 rows of samples" in output
    csv = pd.read_csv(folder / "a.csv", parse_dates=["time"])
    parquet = pd.read_parquet(folder / "a.parquet")
    assert list(csv.columns) == list(parquet.columns)
    for frame in (csv, parquet):
        stamps = frame["time"].map(lambda moment: round(1000.0 * moment.timestamp()))
        assert stamps.tolist() == [NOON_MS + 2000 * slot for slot in range(200)]
        assert frame["op"].tolist() == [0.1 + slot % 7 for slot in range(200)]
        assert frame["auto"].astype(bool).tolist() == [slot % 2 == 0 for slot in range(200)]
        assert "sp" not in frame.columns


def test_an_exported_loop_is_a_recording(url: str, folder: Path) -> None:
    export(url, folder / "fc101.csv", loop="FC101")
    recording = read_recording(folder / "fc101.csv")
    assert len(recording) == 200
    assert recording.period == pytest.approx(2.0)
    assert recording.op[3] == 3.1


@pytest.mark.usefixtures("url")
def test_an_export_is_cut_by_time(folder: Path) -> None:
    run(
        "export", str(folder / "site.toml"), "--loop", "TC7", "--out", str(folder / "cut.csv"),
        "--from", "2026-11-21T12:00:10", "--to", "2026-11-21T13:00:20+01:00",
    )  # fmt: skip
    assert datetime.fromtimestamp(NOON_MS / 1000.0, UTC).isoformat() == "2026-11-21T12:00:00+00:00"
    assert pd.read_csv(folder / "cut.csv")["slot"].tolist() == [5, 6, 7, 8, 9, 10]


@pytest.mark.parametrize(
    ("copy", "name"), [(export, "a.csv"), (export, "a.parquet"), (back_up, "a.sqlite")]
)
def test_a_read_only_file_system_is_named(
    url: str, read_only_disk: Path, copy: Callable[[str, Path], object], name: str
) -> None:
    with pytest.raises(StoreError, match=f"{name} cannot be written: .*[Rr]ead-only file system"):
        copy(url, read_only_disk / name)
    assert list(read_only_disk.iterdir()) == []


def test_documents_are_text(url: str, folder: Path) -> None:
    assert export(url, folder / "e.parquet", table="estimates").rows == 1
    text = pd.read_parquet(folder / "e.parquet")["document"].iloc[0]
    assert json.loads(text) == {"a": 1}


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.xlsx", {}, "unknown kind of file"),
        ("a.csv", {"table": "nothing"}, "no table"),
        ("a.csv", {"loop": "FC999"}, "nothing of that"),
        ("a.csv", {"table": "events", "loop": "FC101"}, "not a loop's"),
    ],
)
def test_what_cannot_be_exported_is_reported(
    url: str, folder: Path, name: str, options: dict[str, str], message: str
) -> None:
    with pytest.raises(StoreError, match=message):
        export(url, folder / name, **options)  # type: ignore[arg-type]
    assert list(folder.glob("a.*")) == []


@pytest.mark.usefixtures("url")
def test_a_moment_that_is_none_is_reported(folder: Path) -> None:
    result = CliRunner().invoke(
        app,
        ["export", str(folder / "site.toml"), "--out", str(folder / "a.csv"), "--from", "noon"],
    )
    assert result.exit_code == 2
    assert "2026-11-21T06:00:00+00:00" in result.output
