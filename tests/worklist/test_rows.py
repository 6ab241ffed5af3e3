"""What a historian says about each loop of a fleet whose faults are known."""

from __future__ import annotations

import math
import sqlite3
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from benchmarks.made_fleet import END_MS, Fleet
from estimator import ReasonCode
from estimator.diagnosis.result import CauseName
from fieldlink.store import (
    RENAMED,
    EventRecord,
    FleetReader,
    StoreError,
    WritebackRecord,
    record_work,
)
from fieldlink.store.database import open_for_writing
from fieldlink.store.inserting import insert_batch
from fieldlink.worklist import (
    COLUMNS,
    ReportedLoop,
    WorkListSettings,
    WorkRow,
    Wrong,
    finding_of_diagnosis,
    finding_of_estimate,
    list_loops,
)
from fieldlink.worklist.estimates_over_time import Course
from fieldlink.worklist.finding import Action
from fieldlink.worklist.row import Confidence, Outlook
from fieldlink.worklist.texts import facts_of

END = datetime.fromtimestamp(END_MS / 1000.0, UTC)


@pytest.fixture(scope="module")
def loops(fleet: Fleet) -> dict[str, ReportedLoop]:
    return {loop.row.tag: loop for loop in list_loops(fleet.url)}


def test_every_loop_has_the_fault_it_was_made_with(loops: dict[str, ReportedLoop]) -> None:
    assert {tag: loop.row.finding.wrong.code for tag, loop in loops.items()} == {
        "FC101": "sticky_valve",  # growing
        "FC102": "sticky_valve",  # steady
        "FC103": "quiet",  # repaired
        "FC104": "undetermined",
        "FC105": "manual",
        "FC106": "external_oscillation",
        **{f"FC{number}": "quiet" for number in range(107, 111)},
    }


def test_sticky_valves_come_first_and_the_worse_of_them_before_the_other(
    loops: dict[str, ReportedLoop],
) -> None:
    tags = list(loops)
    assert set(tags[:2]) == {"FC101", "FC102"}
    assert tags.index("FC104") < min(tags.index(f"FC{n}") for n in (103, 107, 108, 109, 110))


def test_a_growing_band_has_a_trend_and_days_to_its_limit(fleet: Fleet) -> None:
    limit = 12.0
    found = list_loops(fleet.url, settings=WorkListSettings(stick_band_limit=limit))
    row = next(loop.row for loop in found if loop.row.tag == "FC101")
    assert row.trend.low > 0.0
    assert row.outlook is Outlook.APPROACHING
    # It grows evenly: the days that are left follow from band and slope.
    straight = (limit - row.stick_band.value) / (row.trend.value / 30.0)
    assert row.days_to_limit.value == pytest.approx(straight, rel=0.2)
    assert row.days_to_limit.low <= row.days_to_limit.value <= row.days_to_limit.high


def test_a_band_over_its_limit_is_over_it_at_once(fleet: Fleet) -> None:
    found = list_loops(fleet.url, settings=WorkListSettings(stick_band_limit=0.5))
    row = next(loop.row for loop in found if loop.row.tag == "FC102")
    assert (row.outlook, row.days_to_limit.value) == (Outlook.REACHED, 0.0)


def test_a_steady_band_does_not_reach_its_limit_soon(loops: dict[str, ReportedLoop]) -> None:
    row = loops["FC102"].row
    assert row.trend.low < 0.0 < row.trend.high
    assert row.days_to_limit.value > 365.0


def test_confidence_is_the_agreement_of_the_newest_windows(
    loops: dict[str, ReportedLoop],
) -> None:
    row = loops["FC102"].row
    assert (row.confidence, row.agreeing, row.judged) == (Confidence.HIGH, 6, 6)
    assert loops["FC104"].row.confidence is Confidence.LOW


def test_undetermined_says_what_would_determine_it(loops: dict[str, ReportedLoop]) -> None:
    finding = loops["FC104"].row.finding
    assert finding.action.code == "measure_again"
    assert any("set-point step" in sentence for sentence in finding.would_determine)


def test_a_cure_in_the_history_is_a_repair_with_before_and_after(
    loops: dict[str, ReportedLoop],
) -> None:
    row = loops["FC103"].row
    assert row.repair is not None
    assert row.state == "done"
    # The last fifth of sixty days is without sticking.
    assert END - row.repair.time == pytest.approx(timedelta(days=12), abs=timedelta(days=1.5))
    before, after = row.repair.before, row.repair.after
    assert before.stick_band > 1.5
    assert math.isnan(after.stick_band)
    assert (before.loss > 0.2, after.loss) == (True, 0.0)


@pytest.mark.parametrize(
    ("verdicts", "S"),
    [
        (("stiction", "no_stiction", "no_stiction"), None),  # the first began before the repair
        (("stiction", "no_stiction"), None),
        (("no_stiction", "stiction"), 6.0),
        (("stiction", "not_assessable", "not_assessable"), 6.0),
    ],
)
def test_a_window_across_a_repair_does_not_hide_what_it_brought(
    verdicts: tuple[str, ...], S: float | None
) -> None:
    sticky = np.array([verdict == "stiction" for verdict in verdicts])
    rows = np.where(sticky[:, None], [6.0, 5.8, 6.2], math.nan)
    course = Course(
        86400.0 * np.arange(sticky.size), verdicts, rows, rows / 3.0, WorkListSettings()
    )
    found = course.typical("stick_band"), course.typical("slip_jump")
    assert found == ((S, S / 3.0) if S else pytest.approx((math.nan, math.nan), nan_ok=True))


def test_work_that_was_noted_starts_the_trend_again(own_fleet: Fleet) -> None:
    done = END_MS - 10 * 86_400_000
    record_work(own_fleet.url, "FC101", "done", owner="Meyer", note="new packing", utc_ms=done)
    row = next(loop.row for loop in list_loops(own_fleet.url) if loop.row.tag == "FC101")
    assert (row.item.owner, row.state) == ("Meyer", "done") if row.item else False
    assert row.repair is not None
    assert row.repair.time.timestamp() == done / 1000.0
    assert "new packing" in row.repair.source
    assert (row.repair.before.windows, row.repair.after.windows) == (20, 10)
    assert any("still sticks" in remark for remark in row.remarks)


def accept_block(fleet: Fleet, hours: float, status: str = "valid") -> float:
    """Store that the PLC accepted a block of FC103's last sticky window; return its S."""
    with FleetReader(fleet.url) as store:
        course = store.course("FC103")
    S = float(course[course["verdict"] == "stiction"]["stick_band"].iloc[-1])
    row = WritebackRecord(
        "FC103",
        END_MS - round(hours * 3_600_000),
        "accepted",
        "the PLC has accepted the block",
        seq=7,
        status=status,
        stick_band=float(np.float32(S)),
    )
    engine = open_for_writing(fleet.url, EventRecord(END_MS, "daemon.start", "daemon", "again"))
    try:
        insert_batch(engine, [row])
    finally:
        engine.dispose()
    return S


def find_fc103(fleet: Fleet) -> WorkRow:
    return next(loop.row for loop in list_loops(fleet.url) if loop.row.tag == "FC103")


def test_a_valve_that_the_plc_compensates_stays_on_the_list(own_fleet: Fleet) -> None:
    """Its newest windows show no sticking, because the compensator keeps the stem at rest."""
    assert find_fc103(own_fleet).finding.wrong is Wrong.QUIET
    S = accept_block(own_fleet, hours=6.0)
    row = find_fc103(own_fleet)
    assert row.finding.wrong is Wrong.STICKY_VALVE
    assert row.stick_band.value == pytest.approx(S)
    assert row.repair is None
    assert any("may compensate" in remark for remark in row.remarks)


def test_a_loop_with_a_new_name_keeps_its_history_and_its_work(own_fleet: Fleet) -> None:
    S = accept_block(own_fleet, hours=6.0)
    record_work(own_fleet.url, "FC103", "planned", owner="Li", utc_ms=END_MS)
    before = find_fc103(own_fleet)
    renamed = EventRecord(END_MS + 3_600_000, RENAMED, "FIC103", "renamed", {"former": "FC103"})
    open_for_writing(own_fleet.url, renamed).dispose()
    rows = {loop.row.tag: loop.row for loop in list_loops(own_fleet.url)}
    assert "FC103" not in rows
    row = rows["FIC103"]
    assert row.stick_band.value == pytest.approx(S)
    assert (row.windows, row.finding) == (before.windows, before.finding)
    assert (row.state, row.item.owner if row.item else "") == ("planned", "Li")


@pytest.mark.parametrize("end", ["withdrawn", "expired", "repaired"])
def test_a_block_that_has_ended_keeps_no_valve_on_the_list(own_fleet: Fleet, end: str) -> None:
    accept_block(own_fleet, hours=30.0 if end == "expired" else 6.0)
    if end == "withdrawn":
        accept_block(own_fleet, hours=5.0, status="withdrawn")
    elif end == "repaired":
        record_work(own_fleet.url, "FC103", "done", utc_ms=END_MS - 4 * 3_600_000)
    assert find_fc103(own_fleet).finding.wrong is Wrong.QUIET


def test_done_and_healthy_asks_to_be_verified(own_fleet: Fleet) -> None:
    record_work(own_fleet.url, "FC103", "done", utc_ms=END_MS - 11 * 86_400_000)
    row = next(loop.row for loop in list_loops(own_fleet.url) if loop.row.tag == "FC103")
    assert any("set it to verified" in remark for remark in row.remarks)


def test_the_newest_word_counts_and_all_are_kept(own_fleet: Fleet) -> None:
    record_work(own_fleet.url, "FC102", "open", author="a")
    record_work(own_fleet.url, "FC102", "planned", owner="Li", author="b")
    row = next(loop.row for loop in list_loops(own_fleet.url) if loop.row.tag == "FC102")
    assert (row.state, row.item.owner if row.item else "") == ("planned", "Li")
    with FleetReader(own_fleet.url) as store:
        assert [said["author"] for said in store.work()] == ["a", "b"]
        assert [event["kind"] for event in store.events(["work.open", "work.planned"])] == [
            "work.open",
            "work.planned",
        ]


def test_a_repair_entered_afterwards_is_the_newest_word(own_fleet: Fleet) -> None:
    record_work(own_fleet.url, "FC102", "planned", owner="Li", utc_ms=END_MS)
    record_work(own_fleet.url, "FC102", "done", note="packing", utc_ms=END_MS - 3_600_000)
    row = next(loop.row for loop in list_loops(own_fleet.url) if loop.row.tag == "FC102")
    assert (row.state, row.item.note if row.item else "") == ("done", "packing")


def test_work_makes_no_historian_and_no_unknown_state(own_fleet: Fleet) -> None:
    with pytest.raises(StoreError, match="run the daemon first"):
        record_work("sqlite:///nowhere.sqlite", "FC101", "open")
    with pytest.raises(StoreError, match="open, planned, done, verified"):
        record_work(own_fleet.url, "FC101", "begun")


def test_a_row_in_plain_types_has_the_documented_columns(loops: dict[str, ReportedLoop]) -> None:
    for rank, loop in enumerate(loops.values(), 1):
        row = loop.row.to_dict(rank)
        assert tuple(row) == COLUMNS
        assert not any(isinstance(value, float) and math.isnan(value) for value in row.values())


def test_a_long_course_is_combined_without_losing_its_shape() -> None:
    n = 400
    settings = WorkListSettings()
    band = np.linspace(2.0, 6.0, n)
    rows = np.stack([band, band - 0.2, band + 0.2], axis=1)
    course = Course(86400.0 * np.arange(n), ("stiction",) * n, rows, rows / 2.0, settings)
    short = course.combined()
    assert len(short) == settings.points
    assert short.times[-1] == course.times[-1]
    assert np.all(np.diff(short.stick_band[:, 0]) > 0.0)
    followed = course.follow(10.0)
    assert followed is not None
    assert followed.stick_band.trend_per_day.value == pytest.approx(4.0 / n, rel=0.05)


def test_a_diagnosis_fills_the_row_and_ranks_its_causes() -> None:
    finding = finding_of_diagnosis(
        [
            {"name": "tight_tuning", "weight": 0.7, "evidence": ["gain margin 1.3"], "action": ""},
            {"name": "saturation", "weight": 0.2, "evidence": [], "action": "larger valve"},
        ]
    )
    assert (finding.wrong, finding.others) == (Wrong.TIGHT_TUNING, (Wrong.SATURATION,))
    assert finding.action.code == "retune"
    assert finding_of_diagnosis([]).wrong is Wrong.UNDETERMINED
    newer = {"name": "of_a_later_release", "weight": 1.0, "evidence": [], "action": "look"}
    assert finding_of_diagnosis([newer]).wrong is Wrong.UNDETERMINED


def test_a_diagnosis_goes_before_the_estimator(fleet: Fleet) -> None:
    tight = finding_of_diagnosis(
        [{"name": "tight_tuning", "weight": 1.0, "evidence": [], "action": "halve the gain"}]
    )
    found = list_loops(fleet.url, diagnose=lambda name, _: tight if name == "FC107" else None)
    row = next(loop.row for loop in found if loop.row.tag == "FC107")
    assert row.finding.action_text == "halve the gain"


def test_a_healthy_valve_in_an_oscillating_loop_is_not_the_end_of_it() -> None:
    document = {
        "verdict": "no_stiction",
        "reasons": ["a healthy valve explains PV"],
        "reason_codes": ["healthy_valve_suffices"],
        "advice": ["Nothing to do at the valve."],
    }
    assert finding_of_estimate(document).wrong is Wrong.QUIET
    swings = finding_of_estimate(document, oscillates=True, period_s=84.0)
    assert swings.wrong is Wrong.UNDETERMINED
    assert "84 s" in swings.main.evidence[0]
    assert "manual" in swings.would_determine[0]
    doubtful = finding_of_estimate(replace_verdict(document))
    assert (doubtful.wrong, doubtful.is_sure) == (Wrong.UNDETERMINED, False)


def replace_verdict(document: dict[str, object]) -> dict[str, object]:
    return document | {"uncertain": True, "verdict": "stiction"}


def test_urgency_puts_work_that_is_done_behind_open_work(loops: dict[str, ReportedLoop]) -> None:
    row = loops["FC101"].row
    from fieldlink.worklist import WorkItem

    assert replace(row, item=WorkItem("done")).urgency > row.urgency


def test_a_historian_of_an_earlier_release_is_read_and_brought_up_to_date(
    own_fleet: Fleet,
) -> None:
    with closing(sqlite3.connect(own_fleet.file)) as file:
        file.execute("DROP TABLE work")
        file.execute("UPDATE meta SET value = '2' WHERE key = 'schema'")
        file.commit()
    assert len(list_loops(own_fleet.url)) == own_fleet.loops
    record_work(own_fleet.url, "FC101", "planned")
    row = next(loop.row for loop in list_loops(own_fleet.url) if loop.row.tag == "FC101")
    assert row.state == "planned"


def test_what_to_do_at_a_sticky_valve_has_one_wording() -> None:
    wording = "heck the packing, the positioner and the air supply"
    assert wording in ReasonCode.STICKY_VALVE_EXPLAINS.advice
    assert wording in Action.REPAIR_VALVE.text
    assert wording in CauseName.STICKY_VALVE.action


def test_facts_say_which_turns_of_op_are_counted(loops: dict[str, ReportedLoop]) -> None:
    named = dict(facts_of(loops["FC101"].row))
    assert "reversals of OP a day, turns below 0.2 % left out" in named
    assert "avoidable: share of PV's variance that sticking makes" in named
