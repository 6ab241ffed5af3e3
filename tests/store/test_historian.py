"""What is handed to the historian is in the database, or it is counted and said."""

from __future__ import annotations

import math
import sqlite3
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pandas as pd
import pytest

from fieldlink.store import (
    EstimateRecord,
    EventRecord,
    Historian,
    HistorianSettings,
    SampleRecord,
    StoreError,
    WritebackRecord,
    last_blocks,
    read_estimates,
    read_events,
    read_samples,
    read_writebacks,
)

NOON_MS = 1_795_262_400_000
OPENED = EventRecord(NOON_MS, "start", "daemon", "started")
QUICK = HistorianSettings(linger=0.01, retry=0.02, busy_timeout=0.02, flush=60.0)


def sample(slot: int, op: float = 1.0, loop: str = "FC101") -> SampleRecord:
    return SampleRecord(loop, NOON_MS + 1000 * slot, slot, op, 2.0, None, True, 0)


@pytest.fixture
def url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'data' / 'history.sqlite'}"


def hold_lock(url: str) -> sqlite3.Connection:
    other = sqlite3.connect(url.removeprefix("sqlite:///"), isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    return other


def wait_for_retry(historian: Historian) -> None:
    while historian.report().retries == 0:
        time.sleep(0.005)


def test_everything_that_was_put_is_there_after_stop(url: str) -> None:
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    for slot in range(5000):
        assert historian.put(sample(slot))
    report = historian.stop()
    assert (report.written, report.dropped, report.waiting) == (5001, 0, 0)
    assert read_samples(url)["slot"].tolist() == list(range(5000))


def test_what_is_put_in_the_last_moment_is_stored(url: str) -> None:
    for slot in range(8):
        # It looks into the queue all the time, so that the stop comes between two looks.
        historian = Historian(url, replace(QUICK, linger=0.0))
        historian.start(OPENED)
        assert historian.put(sample(slot))
        assert historian.stop().written == 2
    assert len(read_samples(url)) == 8


def test_rows_come_back_as_they_went_in(url: str) -> None:
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    historian.put(sample(0, op=math.nan))
    historian.put(
        EstimateRecord(
            "FC101", NOON_MS, NOON_MS, 0, 9, "estimated", "", verdict="stiction",
            stick_band=7.0, document={"fit": {"r2": math.nan}, "reasons": ["a"]},
        )
    )  # fmt: skip
    historian.put(WritebackRecord("FC101", NOON_MS, "committed", "", seq=3, words=(1, 2)))
    historian.stop()
    samples = read_samples(url)
    assert math.isnan(samples["op"][0])
    assert math.isnan(samples["sp"][0])
    assert samples["time"][0] == pd.Timestamp(NOON_MS, unit="ms", tz="UTC")
    estimate = read_estimates(url, "FC101").iloc[0]
    assert estimate["stick_band"] == 7.0
    assert estimate["document"] == {"fit": {"r2": None}, "reasons": ["a"]}
    assert read_writebacks(url).iloc[0]["words"] == [1, 2]
    assert read_events(url)["kind"].tolist() == ["start"]


def test_figures_that_no_estimate_has_are_not_a_number(url: str) -> None:
    """As in the first days of a loop that cannot be judged yet: `fieldlink status` reads them."""
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    record = EstimateRecord("FC101", NOON_MS, NOON_MS, 0, 9, "estimated", "", "not_assessable")
    historian.put(record)
    historian.stop()
    found = read_estimates(url)
    assert math.isnan(found["stick_band"].iloc[-1])
    assert math.isnan(found["r2"].iloc[-1])


def test_a_frame_is_cut_by_loop_and_time(url: str) -> None:
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    for slot in range(10):
        historian.put(sample(slot))
        historian.put(sample(slot, loop="TC7"))
    historian.stop()
    moments = [datetime.fromtimestamp(NOON_MS / 1000 + s, UTC) for s in (3, 6)]
    frame = read_samples(url, "TC7", since=moments[0], until=moments[1])
    assert frame["slot"].tolist() == [3, 4, 5, 6]
    with pytest.raises(StoreError, match="time zone"):
        read_samples(url, since=datetime(2026, 1, 1))  # noqa: DTZ001


def test_an_empty_table_is_an_empty_frame(url: str) -> None:
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    historian.stop()
    assert read_samples(url).empty
    assert "stick_band" in read_estimates(url).columns


def test_a_second_run_appends(url: str) -> None:
    for slot in range(2):
        historian = Historian(url, QUICK)
        historian.start(OPENED)
        historian.put(sample(slot))
        historian.stop()
    assert read_samples(url)["slot"].tolist() == [0, 1]
    assert len(read_events(url)) == 2


def test_a_lock_of_another_program_delays_and_loses_nothing(url: str) -> None:
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    other = hold_lock(url)
    historian.put(sample(0))
    wait_for_retry(historian)
    assert "locked" in historian.report().last_error
    assert historian.report().waiting == 1
    other.close()
    assert historian.stop().dropped == 0
    assert len(read_samples(url)) == 1


def test_a_full_queue_drops_samples_first_and_counts_them(url: str) -> None:
    historian = Historian(url, HistorianSettings(queue=10, linger=0.01, retry=0.02, flush=60.0,
                                                 busy_timeout=0.02))  # fmt: skip
    historian.start(OPENED)
    other = hold_lock(url)
    historian.put(sample(0))
    wait_for_retry(historian)
    accepted = [historian.put(sample(slot)) for slot in range(1, 12)]
    assert accepted == [True] * 9 + [False] * 2
    assert historian.put(WritebackRecord("FC101", NOON_MS, "committed", ""))
    other.close()
    report = historian.stop()
    assert report.dropped == 2
    assert len(read_samples(url)) == 10
    assert len(read_writebacks(url)) == 1


def test_the_store_itself_says_how_much_is_missing_from_it(url: str) -> None:
    small = HistorianSettings(queue=10, linger=0.01, retry=0.02, busy_timeout=0.02)
    historian = Historian(url, small)
    historian.start(OPENED)
    other = hold_lock(url)
    historian.put(sample(0))
    wait_for_retry(historian)
    assert [historian.put(sample(slot)) for slot in range(1, 15)].count(False) == 5
    other.close()
    while historian.report().waiting:
        time.sleep(0.005)
    assert historian.put(sample(20))
    historian.stop()
    events = read_events(url)
    lost = events[events["kind"] == "store.lost"]["message"].tolist()
    assert len(lost) == 1
    assert lost[0].startswith("5 records were lost")


def test_the_files_are_for_the_owner_and_the_group_to_read(url: str) -> None:
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    file = Path(url.removeprefix("sqlite:///"))
    assert file.with_name(file.name + "-wal").exists()
    for part in (file, file.with_name(file.name + "-wal"), file.parent):
        assert part.stat().st_mode & 0o027 == 0, part
    historian.stop()


def test_stopping_against_a_lock_ends_and_counts_what_is_lost(url: str) -> None:
    historian = Historian(url, HistorianSettings(linger=0.01, flush=0.1, busy_timeout=0.02))
    historian.start(OPENED)
    other = hold_lock(url)
    historian.put(sample(0))
    assert historian.stop().dropped == 1
    other.close()


def test_a_row_that_is_refused_does_not_take_others_along(url: str) -> None:
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    historian.put(sample(0))
    historian.put(WritebackRecord("FC101", NOON_MS, None, ""))  # type: ignore[arg-type]
    historian.put(sample(1))
    report = historian.stop()
    assert report.dropped == 1
    assert "NOT NULL" in report.last_error
    assert len(read_samples(url)) == 2


def test_a_data_directory_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match=r"file.* cannot be made.*data_dir"):
        Historian(f"sqlite:///{tmp_path}/file/history.sqlite").start(OPENED)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "history.sqlite").mkdir()
    with pytest.raises(StoreError, match=r"history\.sqlite cannot be written"):
        Historian(f"sqlite:///{tmp_path}/history.sqlite").start(OPENED)


def test_a_file_that_is_no_database_is_named(tmp_path: Path) -> None:
    (tmp_path / "history.sqlite").write_text("nothing of the kind " * 100)
    with pytest.raises(StoreError, match="not a database"):
        Historian(f"sqlite:///{tmp_path}/history.sqlite").start(OPENED)


@pytest.mark.parametrize(
    ("url", "message"),
    [("nonsense", "not a database address"), ("oracle7://x/y", "no driver")],
)
def test_a_wrong_address_is_named(url: str, message: str) -> None:
    with pytest.raises(StoreError, match=message):
        Historian(url).start(OPENED)


def test_another_schema_is_refused(url: str) -> None:
    historian = Historian(url, QUICK)
    historian.start(OPENED)
    historian.stop()
    with sqlite3.connect(url.removeprefix("sqlite:///")) as connection:
        connection.execute("UPDATE meta SET value = '99'")
    connection.close()
    with pytest.raises(StoreError, match="schema 99"):
        Historian(url).start(OPENED)


def test_reading_needs_a_historian(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="there is no historian"):
        read_samples(f"sqlite:///{tmp_path}/none.sqlite")


def test_a_promise_is_kept_when_the_row_is_stored(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'history.sqlite'}"
    historian = Historian(url, HistorianSettings(linger=0.01))
    historian.start(EventRecord(NOON_MS, "start", "test", ""))
    row = WritebackRecord("FC101", NOON_MS, "begun", "", seq=3, bank="A", words=(1, 2))
    assert historian.keep(row).result(30.0)
    assert last_blocks(url) == {"FC101": replace(row, words=[1, 2])}
    assert historian.keep(replace(row, outcome="accepted")).result(30.0)
    assert historian.keep(replace(row, outcome="too_soon", seq=None)).result(30.0)
    assert last_blocks(url)["FC101"].outcome == "accepted"
    historian.stop()


def test_a_promise_is_broken_when_there_is_no_room(tmp_path: Path) -> None:
    historian = Historian(f"sqlite:///{tmp_path / 'history.sqlite'}", HistorianSettings(queue=0))
    assert not historian.keep(WritebackRecord("FC101", NOON_MS, "begun", "")).result(1.0)
