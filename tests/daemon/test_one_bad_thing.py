"""One bad device, loop, estimate or register costs itself and no more, and is told once."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import structlog

from estimator import identify
from fieldlink.daemon.estimation.estimating import Estimate, EstimateOutcome, Findings
from fieldlink.daemon.estimation.pool import EstimatorPool
from fieldlink.daemon.reporting.journal import Journal
from fieldlink.daemon.sampling.slot_placing import CounterPlacer, Place
from fieldlink.daemon.windows.loop_counts import LoopCounts
from fieldlink.daemon.windows.pipeline import LoopPipeline
from fieldlink.links import LinkState, Quality, Reading, Scan, VirtualClock
from fieldlink.links.modbus import ModbusLink
from fieldlink.registers import DataType, Table, Tag
from fieldlink.site import Loop, load_site
from fieldlink.store import (
    EventRecord,
    Record,
    read_estimates,
    read_events,
    read_samples,
    read_slots,
)
from tests.daemon.live import plant_on, running, site_for, until


async def test_an_error_of_one_devices_task_demotes_that_device(
    new_device: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good, bad = new_device(), new_device()
    await good.start()
    await bad.start()
    site = site_for(tmp_path, {"good": good.port, "bad": bad.port})
    scan = ModbusLink.scan
    broken = True

    async def fail(link: ModbusLink) -> Scan:
        if broken and link._settings.name == "bad":
            raise ZeroDivisionError("nobody thought of this")
        return await scan(link)

    monkeypatch.setattr(ModbusLink, "scan", fail)
    async with plant_on(good), plant_on(bad), running(site) as daemon:
        await until(lambda: daemon.status().loops["GOOD"].counts.read >= 40, "the other's samples")
        status = daemon.status()
        assert status.devices["bad"].state is LinkState.DEMOTED
        assert "nobody thought of this" in status.devices["bad"].last_failure
        assert status.devices["good"].failures == 0
        assert status.defects >= 10
        assert status.loops["BAD"].counts.missed > 0
        broken = False
        await until(lambda: daemon.status().loops["BAD"].counts.read >= 3, "its own, later")
        assert daemon.status().devices["bad"].state is LinkState.GOOD
    events = read_events(site.historian_url)
    told = events[events["kind"] == "defect"]
    assert told["source"].tolist() == ["bad"]
    assert "test_one_bad_thing.py" in told["message"].iloc[0]
    kinds = events[events["source"] == "bad"]["kind"].tolist()
    assert kinds[-1] == "device.good"
    assert "daemon.failed" not in events["kind"].tolist()


ANOTHER_LOOP = """
[loops.OTHER]
device = "plc"
op = "OP"
pv = "PV"
scan = "SCAN"
period = 1.0
window = 50
estimate_every = 20.0
"""


async def test_an_error_of_one_loop_or_estimate_leaves_the_others_alone(
    device: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site_for(tmp_path, {"plc": device.port})
    with (tmp_path / "site.toml").open("a") as text:
        text.write(ANOTHER_LOOP + ANOTHER_LOOP.replace("OTHER", "THIRD"))
    site = load_site(tmp_path / "site.toml")
    take, run = LoopPipeline.take, EstimatorPool.run

    def take_or_fail(pipeline: LoopPipeline, *arguments: Any) -> Any:
        if pipeline.name == "OTHER":
            raise KeyError("a loop's own trouble")
        return take(pipeline, *arguments)

    async def run_or_fail(pool: EstimatorPool, request: Any) -> Any:
        if request.loop == "THIRD":
            raise RuntimeError("an estimate's own trouble")
        return await run(pool, request)

    monkeypatch.setattr(LoopPipeline, "take", take_or_fail)
    monkeypatch.setattr(EstimatorPool, "run", run_or_fail)
    async with plant_on(device), running(site) as daemon:
        await until(lambda: daemon.status().loops["PLC"].estimates >= 2, "estimates of the first")
        await until(
            lambda: daemon.status().loops["THIRD"].counts.read >= 80, "samples of the third"
        )
        assert daemon.status().devices["plc"].state is LinkState.GOOD
    assert set(read_samples(site.historian_url)["loop"]) == {"PLC", "THIRD"}
    assert set(read_estimates(site.historian_url)["loop"]) == {"PLC"}
    events = read_events(site.historian_url)
    told = events[events["kind"] == "defect"].set_index("source")["message"]
    assert set(told.index) == {"OTHER", "THIRD"}
    assert "a loop's own trouble" in told["OTHER"]
    assert "an estimate's own trouble" in told["THIRD"]


async def test_a_counter_of_the_wrong_word_order_is_bad_and_harms_nothing(
    device: Any, tmp_path: Path
) -> None:
    site_for(tmp_path, {"plc": device.port})
    rows = (
        (tmp_path / "map.csv").read_text().replace("SCAN,holding,4,uint16", "SCAN,holding,8,uint64")
    )
    (tmp_path / "map.csv").write_text(rows)
    site = load_site(tmp_path / "site.toml")
    # A count of 32 read in the wrong order of words is 2^53, one of 40,000 beyond 2^63.
    device.words[8:12] = [40_000, 0, 0, 0]
    async with plant_on(device), running(site) as daemon:
        await until(lambda: daemon.status().loops["PLC"].counts.bad >= 5, "bad samples")
        assert daemon.status().loops["PLC"].counts.read == 0
        device.words[8:12] = [0, 0, 0, 7]
        await until(lambda: daemon.status().loops["PLC"].counts.restarts == 1, "a count")
        device.words[11] = 8
        await until(lambda: daemon.status().loops["PLC"].counts.read == 1, "a good one")
        assert daemon.stuck() == ()
    samples = read_samples(site.historian_url)
    bad = samples[samples["quality"] != 0]
    codes = {Quality.NO_COUNT.code, Quality.RESTARTED.code}
    assert set(bad["quality"]) == codes
    assert len(bad) == daemon.status().loops["PLC"].counts.bad
    assert bad["op"].isna().all()
    assert samples["slot"].is_monotonic_increasing
    assert samples["slot"].max() < 2**53


def test_a_count_beyond_what_is_one_is_placed_by_the_clock() -> None:
    placer = CounterPlacer(1.0, modulus=2.0**64)
    reads = [
        (0.0, 2.0**63),
        (0.5, 2.0**63),
        (1.0, 2.0**62),
        (2.0, math.nan),
        (3.0, 19.5),
        (4.0, 20.0),
        (5.0, 21.0),
    ]
    placed = [placer.place(now, count) for now, count in reads]
    assert [p.place for p in placed] == [
        Place.NO_COUNT,
        Place.DUPLICATE,
        Place.NO_COUNT,
        Place.NO_COUNT,
        Place.NO_COUNT,
        Place.RESTARTED,
        Place.NEXT,
    ]
    assert [p.slot for p in placed] == [0, 0, 1, 2, 3, 4, 5]


async def test_a_dead_loop_misses_its_slots_while_it_is_dead(
    new_device: Callable[..., Any], tmp_path: Path
) -> None:
    device = new_device()
    await device.start()
    await device.stop()
    site = site_for(tmp_path, {"plc": device.port})
    async with running(site) as daemon:

        def counts() -> LoopCounts:
            return daemon.status().loops["PLC"].counts

        await until(lambda: counts().missed >= 20, "missed slots of a loop without a sample")
        assert counts().read == 0
        elapsed = daemon.status().devices["plc"].plant_time
        assert elapsed - 2.0 <= counts().missed <= elapsed + 2.0
        await device.start()
        async with plant_on(device):
            await until(lambda: counts().read >= 10, "samples")
            missed = counts().missed
            await device.stop()
            await until(lambda: counts().missed >= missed + 10, "missed slots after the last one")
            elapsed = daemon.status().devices["plc"].plant_time
    last = daemon.status().loops["PLC"].counts
    assert last.expected == last.read + last.bad + last.missed
    accounts = read_slots(site.historian_url, "PLC")
    assert accounts["missed"].sum() == last.missed
    assert accounts["expected"].sum() == last.expected


def pipeline(**keys: Any) -> LoopPipeline:
    loop = Loop(device="plc", op="OP", pv="PV", period=2.0, window=50, **keys)
    return LoopPipeline("A", loop, Tag("SCAN", Table.HOLDING, 0, DataType.UINT16))


def take(
    loop: LoopPipeline,
    now: float,
    count: float | None,
    began: float | None = None,
    read: float | None = None,
    *,
    connected: bool = False,
) -> Any:
    """A scan due at plant second ``now``, begun and answered when given; None is no answer."""
    quality = Quality.NOT_READ if count is None else Quality.GOOD
    at = now if began is None else began
    answered = at if read is None else read
    reading = Reading(math.nan if count is None else count, quality, answered, 1e9 + answered)
    readings = dict.fromkeys(("OP", "PV", "SCAN"), reading)
    return loop.take(Scan(readings, at, 1e9 + at, connected=connected), now, now)


def test_slots_run_with_the_clock_and_are_counted_once() -> None:
    loop = pipeline(scan="SCAN")
    for cycle in range(3):
        take(loop, 2.0 * cycle, 10.0 + cycle)
    for second in range(5, 60):
        take(loop, float(second), None)
    # The last sample came at second 4; the slot at second 58 is not overdue yet.
    assert loop.counts == LoopCounts(expected=29, read=3, missed=26)
    take(loop, 60.0, 12.0 + 28.0)
    assert loop.counts == LoopCounts(expected=31, read=4, missed=27)
    # The controller stood still: its counter says that nothing was missed, the clock says how long.
    for second in range(61, 80):
        take(loop, float(second), 40.0)
    take(loop, 80.0, 41.0)
    assert (loop.counts.read, loop.counts.missed, loop.counts.expected) == (5, 35, 40)
    loop.pass_by(86.9, grace=0.0)
    assert loop.counts.missed == 35 + 2
    loop.pass_by(86.9, grace=0.0)
    assert loop.counts.missed == 35 + 2


def test_a_daemon_that_stood_still_leaves_a_gap_and_calls_nothing_a_restart() -> None:
    loop = pipeline(scan="SCAN")
    for cycle in range(3):
        take(loop, 2.0 * cycle, 10.0 + cycle)
    # The scan that was due at second 6 is read half an hour late; the next one repeats its count.
    record = take(loop, 6.0, 13.0 + 900.0, began=6.0 + 1800.0)
    take(loop, 1807.0, 913.0)
    assert (record.slot, record.quality) == (913, 0)
    assert loop.counts.restarts == 0
    assert (loop.counts.expected, loop.counts.read, loop.counts.missed) == (904, 4, 900)
    take(loop, 1808.0, 914.0)
    assert (loop.counts.expected, loop.counts.read, loop.counts.missed) == (905, 5, 900)


def test_a_controller_that_is_a_little_slow_misses_nothing() -> None:
    loop = pipeline(scan="SCAN")
    for poll in range(400):
        take(loop, float(poll), float(math.floor(poll / 2.3)))
    assert loop.counts.missed == 0
    assert loop.counts.read == 174


@pytest.mark.parametrize(("late", "good"), [(0.0, True), (0.49, True), (0.51, False), (1.9, False)])
def test_a_poll_that_begins_late_is_not_good_in_its_nominal_slot(late: float, good: bool) -> None:
    loop = pipeline()
    take(loop, 0.0, 5.0)
    record = take(loop, 2.0, 6.0, began=2.0 + late)
    assert record.slot == 1
    assert record.quality == (0 if good else Quality.LATE.code)
    assert loop.counts.bad == (0 if good else 1)
    assert bool(np.isfinite(loop.request().window.pv[1])) is good
    # A cycle counter tells the moment by itself.
    counted = pipeline(scan="SCAN")
    assert take(counted, 0.0, 5.0, began=late).quality == 0


@pytest.mark.parametrize("share", [0.0, 0.1, 0.45, 0.9])
def test_a_turn_that_always_comes_late_in_the_period_shifts_no_sample(share: float) -> None:
    loop = pipeline()
    for slot in range(40):
        assert take(loop, 2.0 * slot, 5.0, read=2.0 * (slot + share)).quality == 0


@pytest.mark.parametrize(("share", "good"), [(0.0, True), (0.2, True), (0.3, False), (0.9, False)])
def test_what_is_read_after_connecting_is_good_only_near_its_slot(share: float, good: bool) -> None:
    """Connecting takes its time, and nothing before the first sample tells what is usual."""
    loop = pipeline()
    for slot in (0, 1, 2, 3):
        connects = slot in (0, 2)
        read = 2.0 * (slot + (share if connects else 0.0))
        record = take(loop, 2.0 * slot, 5.0, read=read, connected=connects)
        assert record.quality == (Quality.LATE.code if connects and not good else 0)


def test_a_value_read_half_a_period_later_than_usual_is_not_good_in_its_slot() -> None:
    """A silent neighbour on a shared line costs a time-out before the loop's own turn."""
    loop = pipeline()
    for slot in range(60):
        held_up = slot % 5 in (3, 4)
        record = take(loop, 2.0 * slot, 5.0, read=2.0 * (slot + (0.6 if held_up else 0.1)))
        assert (record.quality == Quality.LATE.code) is held_up
    assert loop.counts.bad == 24


def test_a_slow_loop_answered_at_a_later_beat_than_its_own_is_not_good_in_its_slot() -> None:
    loop = pipeline()
    moments = {0.0: True, 2.0: True, 4.0: True, 7.5: False, 8.0: True}
    assert {now: take(loop, now, 5.0).quality == 0 for now in moments} == moments


def test_a_device_that_flaps_is_summed_up() -> None:
    clock, put = VirtualClock(1e9), list[Record]()
    journal = Journal(put.append, clock)
    # An hour of a loose contact: a thousand changes a minute.
    for number in range(60_000):
        clock.advance_to(0.06 * number)
        kind = "device.demoted" if number % 2 == 0 else "device.good"
        journal.event(kind, "plc", "it came or went")
        journal.summarize()
    journal.event("device.demoted", "other", "of another device")
    journal.summarize(at_the_end=True)
    events = [record for record in put if isinstance(record, EventRecord)]
    told = [event for event in events if event.source == "plc"]
    assert len(told) <= 10 + 60
    summaries = [event for event in told if event.kind == "device.flapping"]
    assert sum(int(event.message.split()[0]) for event in summaries) == 60_000 - 10
    assert "device.good: it came or went" in summaries[-1].message
    assert [event.kind for event in events if event.source == "other"] == ["device.demoted"]
    # After a quiet minute its events are told one by one again, whether or not anybody asked.
    clock.advance_to(clock.monotonic() + 61.0)
    journal.event("device.good", "plc", "for good")
    assert put[-1].kind == "device.good"  # type: ignore[attr-defined]


def test_the_log_line_of_a_window_without_figures_is_json() -> None:
    found = Findings.of(identify(np.full(400, 50.0), np.full(400, 20.0)))
    assert found.verdict == "not_assessable"
    journal = Journal(list[Record]().append, VirtualClock(1e9))
    with structlog.testing.capture_logs() as lines:
        journal.estimate(Estimate("A", 0, 399, 1e9, EstimateOutcome.ESTIMATED, findings=found))
    (line,) = lines
    assert json.loads(json.dumps(line, allow_nan=False))["stick_band"] is None
