"""Old samples become averages, old averages go, and the file has a bound."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fieldlink.store import (
    EstimateRecord,
    EventRecord,
    Historian,
    HistorianSettings,
    Retention,
    SampleRecord,
    WritebackRecord,
    read_averages,
    read_estimates,
    read_events,
    read_samples,
    read_writebacks,
)
from fieldlink.store.housekeeping import RetentionClock

QUICK = HistorianSettings(linger=0.01, retry=0.02, busy_timeout=0.5, flush=30.0)
OPENED = EventRecord(1_795_262_400_000, "start", "daemon", "started")
DAY_MS = 86_400_000


@pytest.fixture
def url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'history.sqlite'}"


def filled(url: str, records: list[SampleRecord | WritebackRecord], retention: Retention) -> None:
    historian = Historian(url, QUICK, retention=retention)
    historian.start(OPENED)
    for record in records:
        historian.put(record)
    while historian.report().waiting:
        time.sleep(0.005)
    historian.tidy()
    while historian._sweep_due.is_set() or historian._sweep is not None:
        time.sleep(0.005)
    report = historian.stop()
    assert (report.dropped, report.failing, report.last_error) == (0, False, "")


def test_samples_older_than_the_retention_are_removed_and_all_else_is_kept(url: str) -> None:
    now_ms = round(1000.0 * time.time())
    ages = (5, 3, 1, 0)
    records = [
        SampleRecord("FC101", now_ms - age * DAY_MS, slot, 1.0, 2.0, None, None, 0)
        for slot, age in enumerate(ages)
    ]
    written = WritebackRecord("FC101", now_ms - 5 * DAY_MS, "committed", "")
    filled(url, [*records, written], Retention(samples_days=2.0))
    assert read_samples(url)["slot"].tolist() == [2, 3]
    assert len(read_writebacks(url)) == 1
    assert read_averages(url).empty


def test_averages_are_those_of_the_samples(url: str) -> None:
    rng = np.random.default_rng(5)
    begin = (round(1000.0 * time.time()) - 3 * DAY_MS) // 600_000 * 600_000
    op, pv = 50.0 + rng.standard_normal((2, 1200))
    pv[30:60] = np.nan
    records = [
        SampleRecord(loop, begin + 1000 * k, k, op[k], pv[k], 7.0, k % 4 != 0, int(np.isnan(pv[k])))
        for loop in ("FC101", "TC7")
        for k in range(1200)
    ]
    filled(url, list(records), Retention(samples_days=2.0, average_minutes=10.0))
    assert read_samples(url).empty
    for loop in ("FC101", "TC7"):
        frame = read_averages(url, loop)
        assert frame["samples"].tolist() == [600, 600]
        assert frame["good"].tolist() == [570, 600]
        assert frame["length_ms"].tolist() == [600_000, 600_000]
        assert frame["time"].iloc[0].timestamp() * 1000 == begin
        for part, row in enumerate(frame.to_dict("records")):
            for name, signal in (("op", op), ("pv", pv)):
                values = signal[600 * part : 600 * (part + 1)]
                assert row[f"{name}_mean"] == pytest.approx(np.nanmean(values), rel=1e-12)
                assert row[f"{name}_min"] == np.nanmin(values)
                assert row[f"{name}_max"] == np.nanmax(values)
                assert row[f"{name}_std"] == pytest.approx(np.nanstd(values), rel=1e-6)
            assert row["sp_mean"] == 7.0
            assert row["auto_share"] == pytest.approx(0.75)


def test_what_has_no_good_value_has_no_average(url: str) -> None:
    then = round(1000.0 * time.time()) - 3 * DAY_MS
    bad = SampleRecord("FC101", then, 0, 1.0, float("nan"), None, None, 1)
    filled(url, [bad], Retention(samples_days=2.0, average_minutes=10.0))
    (row,) = read_averages(url).to_dict("records")
    assert (row["op_mean"], row["op_std"], row["good"]) == (1.0, 0.0, 0)
    assert row["pv_mean"] is None or np.isnan(row["pv_mean"])
    assert row["pv_std"] is None or np.isnan(row["pv_std"])


def test_averages_end_too(url: str) -> None:
    now = round(1000.0 * time.time())
    records = [
        SampleRecord("FC101", now - age * DAY_MS, 9 - age, 1.0, 2.0, None, None, 0)
        for age in (9, 5, 3)
    ]
    wanted = Retention(samples_days=2.0, average_minutes=10.0, averages_days=6.0)
    filled(url, list(records), wanted)
    assert len(read_averages(url)) == 2


def test_the_file_keeps_within_its_bound(url: str, tmp_path: Path) -> None:
    now = round(1000.0 * time.time())
    bound = 2_000_000
    historian = Historian(url, QUICK, retention=Retention(max_bytes=bound))
    historian.start(OPENED)
    sizes = []
    for day in range(12):
        for k in range(3000):
            stamp = now - (12 - day) * DAY_MS + 28_800 * k
            historian.put(SampleRecord("FC101", stamp, 3000 * day + k, 1.5, 2.5, 3.5, True, 0))
        while historian.report().waiting:
            time.sleep(0.005)
        historian.tidy()
        while historian._sweep_due.is_set() or historian._sweep is not None:
            time.sleep(0.005)
        sizes.append((tmp_path / "history.sqlite").stat().st_size)
    report = historian.stop()
    assert report.removed > 0
    # One lot more than the bound may be there before a sweep, and stays in the file as free pages.
    assert max(sizes) < 1.4 * bound
    kept = read_samples(url)["slot"]
    assert kept.iloc[-1] == 35_999
    assert kept.is_monotonic_increasing
    assert len(kept) == 36_000 - report.removed


def test_estimates_above_the_bound_cost_no_sample_of_the_last_day(url: str) -> None:
    now = round(1000.0 * time.time())
    bound = 2_000_000
    records: list[Any] = [
        EstimateRecord("FC101", stamp, stamp, k, k, "estimated", "", document={"text": 2000 * "x"})
        for k in range(1000)
        if (stamp := now - (1000 - k) * 400_000)
    ]
    ages = (3 * DAY_MS, 2 * DAY_MS, *(DAY_MS - 60_000 * k for k in range(1, 1001)))
    records += [
        SampleRecord("FC101", now - age, k, 1.0, 2.0, None, None, 0) for k, age in enumerate(ages)
    ]
    filled(url, records, Retention(max_bytes=bound))
    assert len(read_estimates(url)) == 1000
    assert read_samples(url)["slot"].tolist() == list(range(2, 1002))
    told = read_events(url).iloc[-1]
    assert told["kind"] == "store.at_its_bound"
    assert "always kept: raise max_megabytes" in told["message"]


def test_a_clock_that_jumps_ahead_removes_nothing_for_a_day() -> None:
    wall, elapsed = [1000.0 * DAY_MS], [0.0]
    clock = RetentionClock(lambda: wall[0] + elapsed[0], lambda: elapsed[0])
    begin = clock.now()
    wall[0] += 1e9
    elapsed[0] = 3600.0
    assert clock.now() == begin + 3600.0
    elapsed[0] = 80_000.0
    assert clock.now() == begin + 80_000.0
    elapsed[0] = 100_000.0
    assert clock.now() == begin + 1e9 + 100_000.0


def test_a_clock_that_steps_back_is_followed_at_once() -> None:
    wall, elapsed = [1e9], [0.0]
    clock = RetentionClock(lambda: wall[0] + elapsed[0], lambda: elapsed[0])
    clock.now()
    wall[0] -= 7200.0
    elapsed[0] = 10.0
    assert clock.now() == 1e9 - 7200.0 + 10.0


def test_a_daemon_that_begins_with_a_clock_far_ahead_removes_nothing(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = time.time()
    records = [
        SampleRecord("FC101", round(1000.0 * (now - age)), k, 1.0, 2.0, None, None, 0)
        for k, age in enumerate((90_000.0, 3600.0))
    ]
    wanted = Retention(samples_days=2.0)
    filled(url, list(records), wanted)
    ahead = 12.0 * 365.0 * 86_400.0
    clocks = (lambda: time.time() + ahead, time.monotonic)
    monkeypatch.setattr(RetentionClock.__init__, "__defaults__", clocks)
    filled(url, [], wanted)
    assert len(read_samples(url)) == 2
