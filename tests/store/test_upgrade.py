"""A store of the first release goes on with this one; a store of a later one is left alone."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from fieldlink.store import (
    EventRecord,
    FleetReader,
    Historian,
    HistorianSettings,
    SampleRecord,
    SlotRecord,
    StoreError,
    back_up,
    export,
    read_estimates,
    read_events,
    read_samples,
    read_slots,
    read_writebacks,
    record_work,
)
from fieldlink.store.errors import StoreMismatchError
from fieldlink.store.schema import METADATA, SCHEMA_VERSION

QUICK = HistorianSettings(linger=0.01, retry=0.02)
NOON_MS = 1_767_268_800_000
NEW = SampleRecord("FC101", NOON_MS + 3000, 3, 42.5, 53.25, 50.0, True, 0, 3, 1)
OPENED = EventRecord(1_767_300_000_000, "daemon.start", "daemon", "after the upgrade")


@pytest.fixture
def old(tmp_path: Path) -> Path:
    file = tmp_path / "history.sqlite"
    with closing(sqlite3.connect(file)) as made:
        made.executescript(Path(__file__).with_name("first_release.sql").read_text())
    return file


def contents(file: Path) -> dict[str, list[tuple[object, ...]]]:
    with closing(sqlite3.connect(f"file:{file}?mode=ro", uri=True)) as read:
        names = read.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
        return {name: read.execute(f"SELECT * FROM {name}").fetchall() for (name,) in names}


def columns(file: Path) -> dict[str, set[str]]:
    with closing(sqlite3.connect(f"file:{file}?mode=ro", uri=True)) as read:
        return {
            table: {row[1] for row in read.execute(f"PRAGMA table_info({table})")}
            for table in METADATA.tables
        }


def indexes(file: Path) -> set[str]:
    with closing(sqlite3.connect(f"file:{file}?mode=ro", uri=True)) as read:
        found = read.execute("SELECT name FROM sqlite_master WHERE type = 'index' AND sql NOT NULL")
        return {name for (name,) in found}


def test_the_first_release_s_store_is_upgraded_and_keeps_its_data(old: Path) -> None:
    url, before = f"sqlite:///{old}", contents(old)
    back_up(url, old.with_name("before.sqlite"))
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    historian.put(NEW)
    historian.put(SlotRecord("FC101", NOON_MS, 600.0, 600, 598, 0, 2, 0, 0, 0))
    assert historian.stop().dropped == 0
    after = contents(old)
    for name, rows in before.items():
        if name != "meta":
            width = len(rows[0])
            assert [row[:width] for row in after[name]][: len(rows)] == rows
    assert after["meta"] == [("schema", str(SCHEMA_VERSION))]
    # The same tables as those of a store that this release has made.
    assert columns(old) == {
        name: {column.name for column in table.columns} for name, table in METADATA.tables.items()
    }
    made = {index.name for table in METADATA.tables.values() for index in table.indexes}
    assert indexes(old) == made
    samples = read_samples(url, "FC101")
    assert list(samples["pv"].dropna()) == [51.25, 52.25, 53.25]
    assert list(samples["late_ms"].dropna()) == [3.0]
    assert list(read_slots(url, "FC101")["missed"]) == [2]
    assert list(read_estimates(url, "FC101")["stick_band"]) == [7.0]
    assert list(read_writebacks(url, "FC101")["seq"]) == [41]
    assert list(read_events(url)["kind"]) == ["daemon.start", "daemon.start"]
    with FleetReader(url) as store:
        assert store.work() == []
    assert contents(old.with_name("before.sqlite")) == before


def test_an_upgrade_that_was_cut_off_is_completed(old: Path) -> None:
    with closing(sqlite3.connect(old)) as cut_off:
        cut_off.execute("ALTER TABLE samples ADD COLUMN late_ms INTEGER")
    historian = Historian(f"sqlite:///{old}", QUICK)
    historian.start(OPENED)
    historian.stop()
    assert {"late_ms", "clock_steps"} <= columns(old)["samples"]
    assert contents(old)["meta"] == [("schema", str(SCHEMA_VERSION))]


def test_an_old_store_that_is_only_read_says_what_to_do(old: Path) -> None:
    before = old.read_bytes()
    with pytest.raises(StoreError, match=r"schema 1.*fieldlink run"):
        read_samples(f"sqlite:///{old}", "FC101")
    assert old.read_bytes() == before


def test_a_later_release_s_store_is_refused_and_untouched(old: Path) -> None:
    with closing(sqlite3.connect(old)) as later, later:
        later.execute("UPDATE meta SET value = ?", [str(SCHEMA_VERSION + 1)])
    before = contents(old)
    for use in (
        lambda url: Historian(url, QUICK).start(OPENED),
        lambda url: read_samples(url, "FC101"),
    ):
        with pytest.raises(StoreMismatchError) as refused:
            use(f"sqlite:///{old}")
        said = str(refused.value)
        assert f"schema {SCHEMA_VERSION + 1}" in said
        assert "later release" in said
        assert "\n" not in said
    assert contents(old) == before


def test_the_fixture_is_what_the_first_release_made() -> None:
    """Every column of it is still one of ours, with the same name, in the same order."""
    text = Path(__file__).with_name("first_release.sql").read_text()
    for name in ("samples", "estimates", "writebacks", "events"):
        ours = [column.name for column in METADATA.tables[name].columns]
        with closing(sqlite3.connect(":memory:")) as made:
            made.executescript(text.replace("PRAGMA journal_mode = WAL;", ""))
            theirs = [row[1] for row in made.execute(f"PRAGMA table_info({name})")]
        assert theirs == ours[: len(theirs)]


def test_what_an_earlier_release_did_not_store_is_not_there_yet(tmp_path: Path) -> None:
    file = tmp_path / "history.sqlite"
    made = Historian(f"sqlite:///{file}", QUICK)
    made.start(OPENED)
    made.stop()
    with closing(sqlite3.connect(file)) as earlier, earlier:
        earlier.execute("DROP TABLE diagnoses")
        earlier.execute("UPDATE meta SET value = '3' WHERE key = 'schema'")
    with pytest.raises(StoreError, match="if an earlier release wrote it, start the daemon"):
        export(f"sqlite:///{file}", tmp_path / "out.csv", table="diagnoses")


def test_an_empty_file_is_no_historian(tmp_path: Path) -> None:
    file = tmp_path / "history.sqlite"
    file.touch()
    with pytest.raises(StoreError, match="the file is empty"):
        record_work(f"sqlite:///{file}", "FC101", "planned")
    assert file.stat().st_size == 0
