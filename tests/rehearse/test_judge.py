"""How each kind of expectation is judged, on a course made by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from estimator import Interval
from fieldlink.daemon.windows.loop_counts import LoopCounts
from fieldlink.lab.rehearse.expected import Expectation
from fieldlink.lab.rehearse.judge import judge
from fieldlink.lab.rehearse.outcome import RunCourse, Window, track_of
from fieldlink.lab.rehearse.simulated_site import Trend
from fieldlink.store import EventRecord, WritebackRecord

ADAPTER: TypeAdapter[Expectation] = TypeAdapter(Expectation)
UNKNOWN = Interval.unknown()


def window(end: float, verdict: str, S: float = 0.0, reasons: str = "") -> Window:
    band = Interval(S, S - 0.1, S + 0.1) if verdict != "not_assessable" else UNKNOWN
    jump = Interval(0.3 * S, 0.2 * S, 0.4 * S) if verdict != "not_assessable" else UNKNOWN
    return Window(end - 100.0, end, verdict, reasons, 1.0, band, jump)


def writeback(time: float, outcome: str, status: str = "valid") -> WritebackRecord:
    return WritebackRecord(
        loop="LOOP",
        utc_ms=round(1000 * time),
        outcome=outcome,
        reason="",
        seq=None,
        bank=None,
        status=status,
        stick_band=None,
        slip_jump=None,
        words=None,
        bank_before=None,
        active_before=None,
    )


def make_course() -> RunCourse:
    """S rises from 0 to 6; the compensator has the loop from 300 to 449 and then gives up."""
    time = np.arange(600.0)
    compensated = (time >= 300) & (time < 450)
    swing = np.where(compensated, 0.5, 2.0) * np.sin(0.3 * time)
    reason = ["none"] * 450 + ["worse"] * 150
    trend = Trend(
        time=time,
        op=50.0 + swing,
        pv=50.0 + swing,
        measured=50.0 + swing,
        sp=np.full(600, 50.0),
        stem=50.0 + swing,
        stick_band=0.01 * time,
        slip_jump=0.003 * time,
        automatic=np.ones(600, bool),
        compensated=compensated,
        reason=tuple(reason),
    )
    windows = (
        window(200.0, "no_stiction", 0.2),
        window(400.0, "not_assessable", reasons="OP stands still for 99% of the window"),
        window(600.0, "stiction", 5.5),
    )
    return RunCourse(
        trend=trend,
        windows=windows,
        writebacks=(
            writeback(200.0, "accepted", "no_stiction"),
            writeback(300.0, "committed"),
            writeback(302.0, "accepted"),
        ),
        events=(EventRecord(70_000, "device.demoted", "plc", ""),),
        counts=LoopCounts(expected=600, read=590, bad=4, missed=6),
        track=track_of(windows),
    )


VERDICT = {"kind": "verdict", "verdict": "stiction"}
ESTIMATE = {"kind": "estimate", "after": 500.0}
PV = {"kind": "pv_std", "first": (100.0, 300.0), "then": (310.0, 440.0)}


@pytest.mark.parametrize(
    ("expected", "passed"),
    [
        (VERDICT, False),
        (VERDICT | {"windows": "any"}, True),
        (VERDICT | {"windows": "none"}, False),
        (VERDICT | {"windows": "none", "before": 599.0}, True),
        (VERDICT | {"after": 600.0}, True),
        (VERDICT | {"windows": "none", "after": 601.0}, False),  # no window ended there
        ({"kind": "verdict", "verdict": "not_assessable", "after": 300, "before": 500}, True),
        (
            {
                "kind": "verdict",
                "verdict": "not_assessable",
                "windows": "any",
                "reason": "op STANDS still",
            },
            True,
        ),
        (
            {"kind": "verdict", "verdict": "not_assessable", "windows": "any", "reason": "PV"},
            False,
        ),
        # True S of the last window: 5.00 to 5.99; estimated 5.5 within 5.4 to 5.6.
        (ESTIMATE, True),
        (ESTIMATE | {"tolerance": 0.01, "covered": True}, True),
        (ESTIMATE | {"of": "slip_jump"}, True),
        ({"kind": "estimate", "after": 300.0}, False),  # an unknown estimate is not near
        ({"kind": "take_over", "by": 300.0}, True),
        ({"kind": "take_over", "by": 299.0}, False),
        ({"kind": "take_over", "after": 450.0, "by": 600.0}, False),
        ({"kind": "take_over", "never": True}, False),
        ({"kind": "take_over", "after": 450.0, "never": True}, True),
        ({"kind": "fall_back", "by": 450.0}, True),
        ({"kind": "fall_back", "by": 449.0}, False),
        ({"kind": "fall_back", "by": 500.0, "reason": ["worse"]}, True),
        ({"kind": "fall_back", "by": 500.0, "reason": ["expired"]}, False),
        (PV | {"at_most": 0.3}, True),
        (PV | {"at_most": 0.2}, False),
        (PV | {"at_least": 0.2}, True),
        (PV | {"at_least": 0.3}, False),
        ({"kind": "blocks", "at_least": 2, "at_most": 2}, True),
        ({"kind": "blocks", "at_most": 1}, False),
        ({"kind": "blocks", "status": "valid", "at_most": 1}, True),
        ({"kind": "blocks", "after": 303.0, "at_least": 1}, False),
        ({"kind": "samples", "of": "missed", "at_least": 6, "at_most": 6}, True),
        ({"kind": "samples", "of": "bad", "at_most": 3}, False),
        ({"kind": "event", "event": "device.demoted", "by": 70.0}, True),
        ({"kind": "event", "event": "device.demoted", "by": 69.0}, False),
        ({"kind": "event", "event": "device.demoted", "never": True}, False),
        ({"kind": "event", "event": "device.demoted", "after": 71.0, "never": True}, True),
        ({"kind": "event", "event": "device.demoted", "after": 71.0, "by": 99.0}, False),
        ({"kind": "event", "event": "loop.silent", "never": True}, True),
        ({"kind": "change", "direction": "increase", "at": 400.0, "within": 100.0}, False),
        ({"kind": "change", "direction": "increase", "never": True}, True),
    ],
)
def test_an_expectation_is_judged(expected: dict[str, Any], passed: bool) -> None:
    finding = judge(ADAPTER.validate_python(expected), make_course())
    assert finding.passed is passed, finding


def test_tracking_finds_the_window_of_a_change() -> None:
    S = [1.0, 1.1, 0.9, 1.0, 1.05, 1.0, 4.0, 4.1, 3.9]
    windows = tuple(window(100.0 * (k + 1), "stiction", s) for k, s in enumerate(S))
    course = replace(make_course(), windows=windows, track=track_of(windows))
    found = {"kind": "change", "direction": "increase", "at": 650.0}
    assert judge(ADAPTER.validate_python(found | {"within": 50.0}), course).passed
    assert not judge(ADAPTER.validate_python(found | {"within": 49.0}), course).passed
    assert not judge(
        ADAPTER.validate_python({"kind": "change", "direction": "increase", "never": True}), course
    ).passed
    assert judge(
        ADAPTER.validate_python({"kind": "change", "direction": "decrease", "never": True}), course
    ).passed


def test_a_finding_says_what_was_seen() -> None:
    finding = judge(ADAPTER.validate_python(VERDICT), make_course())
    assert finding.expected == "verdict stiction in all of the windows"
    assert finding.found == "200 s no_stiction, 400 s not_assessable, 600 s stiction"


def test_a_window_without_stiction_is_tracked_as_none_whatever_s_it_might_have() -> None:
    healthy = [window(100.0 * (k + 1), "no_stiction", S=3.0 * k) for k in range(8)]
    calm = track_of([*healthy, window(900.0, "not_assessable")])
    assert calm is not None
    assert calm.stick_band.times.tolist() == [100.0 * (k + 1) for k in range(8)]
    assert calm.stick_band.changes == ()
    assert np.abs(calm.stick_band.value).max() < 1.0
    sticky = [window(900.0, "stiction", 8.0), window(1000.0, "stiction", 8.0)]
    worn = track_of([*healthy, *sticky])
    assert worn is not None
    assert [(c.kind.value, c.onset) for c in worn.stick_band.changes] == [("increase", 8)]
