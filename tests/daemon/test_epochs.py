"""A loop's state belongs to what the loop is: what is asked or found for another is not used."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from fieldlink.daemon.diagnosis.rounds import DiagnosisRounds
from fieldlink.daemon.estimation.answers import InlineWorker
from fieldlink.daemon.estimation.estimating import Estimate, EstimateOutcome, Findings
from fieldlink.daemon.loop import LoopRunner
from fieldlink.daemon.reporting.journal import Journal
from fieldlink.daemon.sampling.device import DeviceRunner
from fieldlink.daemon.site_runner import SiteRunner
from fieldlink.links import Quality, Reading, Scan, SystemClock
from fieldlink.site import Site, load_site
from fieldlink.store import EventRecord, FindingRecord, Historian

WRITEBACK = """
[loops.LOOP.writeback]
enabled = true
loop_id = 101
base = 100
min_windows = 1
"""


def scan_of(slot: int) -> Scan:
    def reading(value: float) -> Reading:
        return Reading(value, Quality.GOOD, float(slot), float(slot))

    values = {"OP": 50.0 + slot % 7, "PV": 40.0 + slot % 5, "SCAN": float(slot)}
    return Scan({tag: reading(value) for tag, value in values.items()}, slot, slot, 1, ())


def runner_of(site: Site) -> DeviceRunner:
    return SiteRunner(site, SystemClock(), lambda _: None).runners["plc"]


def filled(runner: DeviceRunner, samples: int = 60) -> LoopRunner:
    loop = runner.loops["PLC"]
    for slot in range(samples):
        loop.take(scan_of(slot), float(slot), None, answers=True)
    return loop


def answer(loop: LoopRunner, findings: Findings) -> tuple[Estimate, Any]:
    request = loop.request()
    window = request.window
    outcome = EstimateOutcome.ESTIMATED
    made = Estimate(
        "PLC", window.first_slot, window.last_slot, window.end_utc, outcome, findings=findings
    )
    return made, request


def reloaded(site: Site, old: str, new: str) -> Site:
    for name in ("site.toml", "map.csv"):
        file = site.path.with_name(name)
        file.write_text(file.read_text().replace(old, new))
    return load_site(site.path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('host = "127.0.0.1"', 'host = "127.0.0.2"'),
        ("port = 502\n", "port = 503\n"),
        ('host = "127.0.0.1"', 'host = "127.0.0.1"\nunit = 2'),
        ("PV,holding,2,float32", "PV,holding,6,float32"),
    ],
    ids=["host", "port", "unit", "tag"],
)
def test_another_valve_begins_with_nothing(
    tmp_path: Path, live: Any, findings: Callable[..., Findings], old: str, new: str
) -> None:
    site = live.site_for(tmp_path, {"plc": 502}, WRITEBACK)
    before = runner_of(site)
    loop = filled(before)
    estimate, request = answer(loop, findings(7.0))
    late, late_request = answer(loop, findings(9.0))
    assert loop.accept(estimate, request)
    assert loop.writer is not None
    assert loop.writer.waiting is not None

    after = runner_of(reloaded(site, old, new))
    after.carry_over(before)
    begun = after.loops["PLC"]
    assert begun.pipeline.counts.read == 0
    assert begun.writer is not None
    assert begun.writer.waiting is None
    # What was in flight is dropped, and counted.
    assert not begun.accept(late, late_request)
    assert begun.status("plc").dropped_estimates == 1
    assert begun.writer.waiting is None


def test_an_estimate_of_before_a_reload_is_asked_for_again(
    tmp_path: Path, live: Any, findings: Callable[..., Findings]
) -> None:
    site = live.site_for(tmp_path, {"plc": 502}, WRITEBACK)
    before = runner_of(site)
    loop = filled(before)
    late, request = answer(loop, findings(7.0))
    assert loop.pipeline.samples_until_estimate > 0
    after = runner_of(reloaded(site, "timeout = 4.0", "timeout = 3.0"))
    after.carry_over(before)
    kept = after.loops["PLC"]
    assert kept.pipeline.counts.read == 60
    assert kept.pipeline.samples_until_estimate == 0
    assert not kept.accept(late, request)


def test_numbers_of_blocks_go_on_when_a_loop_comes_back(tmp_path: Path, live: Any) -> None:
    site = live.site_for(tmp_path, {"plc": 502}, WRITEBACK)
    site_runner = SiteRunner(site, SystemClock(), lambda _: None)
    first = site_runner.runners["plc"].loops["PLC"]
    again = site_runner.runner(site, "plc").loops["PLC"]
    assert first.writer is not None
    assert again.writer is not None
    first.writer._handover._numbers.learn(41)
    assert again.writer._handover._numbers.last == 41


def test_a_loop_with_a_new_name_keeps_its_window_its_numbers_and_its_orders(
    tmp_path: Path, live: Any
) -> None:
    site = live.site_for(tmp_path, {"plc": 502}, WRITEBACK)
    before = runner_of(site)
    loop = filled(before)
    loop.numbers.learn(41)
    loop.orders.hold = "B. Okafor: watched today"
    told: list[Any] = []
    renamed = reloaded(site, "[loops.PLC", "[loops.FIC101")
    after = SiteRunner(renamed, SystemClock(), told.append).runners["plc"]
    after.carry_over(before)
    kept = after.loops["FIC101"]
    assert kept.pipeline.counts.read == 60
    assert (kept.numbers.last, kept.orders.hold) == (41, "B. Okafor: watched today")
    assert [(row.kind, row.source) for row in told] == [
        ("loop.renamed", "FIC101"),
        ("operator.hold", "FIC101"),
        ("loop.left", "PLC"),
    ]
    assert told[0].detail == {"former": "PLC"}
    record = kept.take(scan_of(60), 60.0, None, answers=True)
    assert record is not None
    assert record.loop == "FIC101"


def test_what_was_found_of_a_loop_goes_on_under_its_new_name(tmp_path: Path, live: Any) -> None:
    site = live.site_for(tmp_path, {"plc": 502})
    names = ("PLC", "FIC101", "FIC101A")
    runner = runner_of(site)
    for before, after in pairwise(names):
        site = reloaded(site, f"[loops.{before}", f"[loops.{after}")
        older, runner = runner, SiteRunner(site, SystemClock(), lambda _: None).runners["plc"]
        runner.carry_over(older)
    rows: list[Any] = []
    historian = Historian(site.historian_url)
    historian.start(EventRecord(1, "daemon.start", "daemon", "test"))
    historian.put(
        FindingRecord("F1", 10, 5, "confirmed", "sticky_valve", "PLC", ("PLC",), 9.0, 0.8, "", {})
    )
    historian.stop()
    clock = SystemClock()
    journal = Journal(rows.append, clock)
    rounds = DiagnosisRounds(
        lambda: {"plc": runner}, rows.append, journal, clock, site.historian_url
    )

    async def one_round() -> None:
        await rounds.resume()
        for _ in range(2):
            await rounds.run(lambda: site, InlineWorker())

    asyncio.run(one_round())
    (finding,) = rounds.report().open
    assert (finding.id, finding.loop, finding.loops) == ("F1", "FIC101A", ("FIC101A",))
    told = [row for row in rows if isinstance(row, FindingRecord) and row.finding == "F1"]
    assert [row.message for row in told] == ["new names in the site file: PLC is FIC101A now"]


def test_findings_of_loops_that_left_close_though_nothing_is_diagnosed(
    tmp_path: Path, live: Any
) -> None:
    """They stayed open until another loop had a new window: with a lost device, never."""
    site = live.site_for(tmp_path, {"plc": 502})
    historian = Historian(site.historian_url)
    historian.start(EventRecord(1, "daemon.start", "daemon", "test"))
    for name, loop in (("F1", "PLC"), ("F2", "LC7")):
        historian.put(
            FindingRecord(name, 10, 5, "confirmed", "sticky_valve", loop, (loop,), 9.0, 0.8, "", {})
        )
    historian.stop()
    rows: list[Any] = []
    journal = Journal(rows.append, SystemClock())
    runner = runner_of(site)
    rounds = DiagnosisRounds(
        lambda: {"plc": runner}, rows.append, journal, SystemClock(), site.historian_url
    )

    async def one_round() -> None:
        await rounds.resume()
        await rounds.run(lambda: site, InlineWorker())

    asyncio.run(one_round())
    assert [one.id for one in rounds.report().open] == ["F1"]
    (closed,) = [row for row in rows if isinstance(row, FindingRecord)]
    assert (closed.finding, closed.state) == ("F2", "closed")
    assert closed.message == "the site has no loop LC7 any more"


def test_a_request_carries_its_loops_epoch(tmp_path: Path, live: Any) -> None:
    site = live.site_for(tmp_path, {"plc": 502})
    loop = filled(runner_of(site))
    assert loop.request().epoch == loop.epoch
    assert replace(loop.spec).has_samples_of(loop.spec)
