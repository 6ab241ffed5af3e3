"""Events come once, in the order in which they were stored."""

from __future__ import annotations

import shutil
from pathlib import Path

from fieldlink.store import EventRecord, EventStream, Historian, HistorianSettings


def store(url: str, *times: int) -> None:
    historian = Historian(url, HistorianSettings(linger=0.0))
    historian.start(EventRecord(times[0], "start", "daemon", ""))
    for utc_ms in times[1:]:
        historian.put(EventRecord(utc_ms, "kind", "plc", ""))
    historian.stop()


def test_events_after_the_clock_was_set_back_are_new_all_the_same(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/data/history.sqlite"
    store(url, 9_000_000, 9_000_001, 9_000_002)
    stream = EventStream(url)
    assert [event.utc_ms for event in stream.begin(2)] == [9_000_001, 9_000_002]
    assert stream.follow() == ()
    store(url, 5_400_000, 5_400_000)
    assert [event.utc_ms for event in stream.follow()] == [5_400_000, 5_400_000]
    # A new file in the place of a damaged one.
    shutil.rmtree(tmp_path / "data")
    store(url, 9_100_000, 9_100_001)
    assert [event.utc_ms for event in stream.follow()] == [9_100_000, 9_100_001]
    assert EventStream(url).begin(0) == ()
