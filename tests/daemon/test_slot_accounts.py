"""Every slot is accounted for: in the counts, in the store, and by how late it came."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from fieldlink.daemon.sampling.lateness import BOUNDS, Lateness
from fieldlink.daemon.sampling.slot_accounts import SlotAccounts
from fieldlink.daemon.windows.loop_counts import LoopCounts
from fieldlink.daemon.windows.pipeline import LoopPipeline
from fieldlink.links import Quality, Reading, Scan, VirtualClock
from fieldlink.site import Loop
from fieldlink.store import Record, SlotRecord, read_samples, read_slots


async def test_the_store_accounts_for_every_slot(device: Any, tmp_path: Path, live: Any) -> None:
    site = live.site_for(tmp_path, {"plc": device.port})
    async with live.plant_on(device), live.running(site) as daemon:
        await live.until(lambda: daemon.status().loops["PLC"].counts.read >= 30, "samples")
    counts = daemon.status().loops["PLC"].counts
    accounts = read_slots(site.historian_url, "PLC")
    for name in ("expected", "read", "late", "missed", "bad", "duplicates", "restarts"):
        assert accounts[name].sum() == getattr(counts, name), name
    late = read_samples(site.historian_url)["late_ms"]
    assert (late >= 0).all()
    # A plant second is 20 ms here, and what comes a tenth of that late is counted as late.
    assert (late > 2).sum() <= counts.late + len(late) // 4
    assert (late > 3).sum() <= counts.late


def test_an_account_holds_what_came_since_the_last() -> None:
    put: list[Record] = []
    clock = VirtualClock(1e9)
    accounts = SlotAccounts(put.append, clock)
    clock.advance_to(600.0)
    accounts.close({"A": LoopCounts(10, 8, 1, 1, 2), "B": LoopCounts()})
    clock.advance_to(1200.0)
    accounts.close({"A": LoopCounts(30, 28, 1, 1, 2), "B": LoopCounts(5, 5)})
    # B was changed by a reload and counts anew.
    clock.advance_to(1800.0)
    accounts.close({"A": LoopCounts(30, 28, 1, 1, 2), "B": LoopCounts(3, 2, 1)})
    assert put == [
        SlotRecord("A", 1_000_000_600_000, 600.0, 10, 8, 2, 1, 1, 0, 0),
        SlotRecord("A", 1_000_001_200_000, 600.0, 20, 20, 0, 0, 0, 0, 0),
        SlotRecord("B", 1_000_001_200_000, 600.0, 5, 5, 0, 0, 0, 0, 0),
        SlotRecord("B", 1_000_001_800_000, 600.0, 3, 2, 0, 0, 1, 0, 0),
    ]


@pytest.mark.parametrize(("delay", "late"), [(0.0, 0), (0.09, 0), (0.11, 1), (3.0, 1)])
def test_late_is_what_comes_a_tenth_of_a_period_after_it_was_due(delay: float, late: int) -> None:
    pipeline = LoopPipeline("A", Loop(device="plc", op="OP", pv="PV", period=2.0), None, speed=2.0)
    reading = Reading(1.0, Quality.GOOD, 100.0 + delay, 1e9)
    record = pipeline.take(Scan({"OP": reading, "PV": reading}, 100.0, 1e9), 0.0, due=100.0)
    assert pipeline.counts == LoopCounts(expected=1, read=1, late=late)
    assert record is not None
    assert record.late_ms == round(1000.0 * delay)


def test_lateness_falls_into_its_class() -> None:
    lateness = Lateness()
    for seconds in (0.0, 0.005, 0.0051, 0.3, 99.0):
        lateness.note(seconds)
    report = lateness.report()
    assert len(report.counts) == len(BOUNDS) + 1
    assert (report.counts[0], report.counts[1], report.counts[-1]) == (2, 1, 1)
    assert sum(report.counts) == 5
    assert report.largest == 99.0
