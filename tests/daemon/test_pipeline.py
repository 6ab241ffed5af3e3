from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from fieldlink.daemon.windows.loop_counts import LoopCounts
from fieldlink.daemon.windows.pipeline import LoopPipeline
from fieldlink.links import Quality, Reading, Scan
from fieldlink.registers import DataType, Table, Tag
from fieldlink.site import Loop

TAGS = {"op": "OP", "pv": "PV", "sp": "SP", "mode": "MODE", "scan": "SCAN"}


def pipeline(**changes: Any) -> LoopPipeline:
    keys: dict[str, Any] = {"device": "plc", "period": 2.0, "window": 50, "auto_values": (1.0, 3.0)}
    loop = Loop(**keys | TAGS | changes)
    return LoopPipeline("FC101", loop, Tag("SCAN", Table.HOLDING, 0, DataType.UINT16))


def scan(at: float, bad: dict[str, Quality] | None = None, **values: float) -> Scan:
    """A scan at plant second ``at``; a tag that is not named is 1, its quality good."""
    bad = bad or {}
    readings = {}
    for tag in TAGS.values():
        quality = bad.get(tag, Quality.GOOD)
        value = values.get(tag, 1.0) if quality is Quality.GOOD else math.nan
        readings[tag] = Reading(value, quality, at, 1000.0 + at)
    return Scan(readings, at, 1000.0 + at)


def test_a_sample_has_all_signals_of_the_loop() -> None:
    record = pipeline().take(scan(0.0, OP=40.0, PV=7.0, SP=8.0, MODE=3.0, SCAN=12.0), 0.0)
    assert record is not None
    assert (record.op, record.pv, record.sp, record.auto) == (40.0, 7.0, 8.0, True)
    assert (record.utc_ms, record.slot, record.quality) == (1_000_000, 12, 0)


@pytest.mark.parametrize(
    ("mode", "bad", "auto"),
    [(1.0, {}, True), (2.0, {}, False), (1.0, {"MODE": Quality.NOT_READ}, None)],
)
def test_the_mode_says_whether_the_loop_is_in_automatic(
    mode: float, bad: dict[str, Quality], auto: bool | None
) -> None:
    record = pipeline().take(scan(0.0, bad, MODE=mode), 0.0)
    assert record is not None
    assert record.auto is auto


def test_every_slot_is_counted_once() -> None:
    loop = pipeline()
    for at, count, bad in (
        (0.0, 1, {}),
        (1.0, 1, {}),
        (2.0, 2, {"PV": Quality.ABOVE_RANGE}),
        (4.0, 3, {"OP": Quality.NOT_READ}),
        (6.0, 4, {}),
        (8.0, 5, {"SCAN": Quality.QUARANTINED}),
        (12.0, 7, {}),
    ):
        loop.take(scan(at, bad, SCAN=float(count)), at)
    assert loop.counts == LoopCounts(expected=7, read=3, bad=1, missed=3, duplicates=1)
    window = loop.request().window
    np.testing.assert_array_equal(
        np.isfinite(window.pv), [True, False, False, True, False, False, True]
    )
    assert math.isfinite(window.op[1])


def test_a_counter_of_the_map_wraps_as_its_register_does() -> None:
    loop = pipeline()
    for at, count in ((0.0, 65535.0), (2.0, 0.0), (4.0, 1.0)):
        loop.take(scan(at, SCAN=count), at)
    assert loop.counts == LoopCounts(expected=3, read=3)


def test_the_zeros_of_a_plc_that_starts_again_are_bad() -> None:
    loop = pipeline()
    rows = []
    for at, count, value in ((0.0, 700, 40.0), (6.0, 0, 0.0), (8.0, 0, 0.0), (10.0, 1, 41.0)):
        rows.append(loop.take(scan(at, SCAN=float(count), OP=value, PV=value), at))
    assert [None if row is None else (row.slot, row.quality) for row in rows] == [
        (700, 0),
        (703, Quality.RESTARTED.code),
        None,
        (704, 0),
    ]
    np.testing.assert_array_equal(
        loop.request().window.pv, [40.0, math.nan, math.nan, math.nan, 41.0]
    )
    assert loop.counts == LoopCounts(expected=5, read=2, bad=1, missed=2, duplicates=1, restarts=1)


def test_without_a_counter_the_beat_places_samples() -> None:
    loop = pipeline(scan=None, sp=None, mode=None)
    for at in (0.0, 1.0, 2.0, 6.0):
        loop.take(scan(at), at)
    assert loop.counts == LoopCounts(expected=4, read=3, missed=1, duplicates=1)
    window = loop.request().window
    assert window.sp is None
    assert window.auto is None


def test_an_estimate_is_due_when_the_window_is_full_and_then_every_interval() -> None:
    loop = pipeline(estimate_every=20.0)
    due = []
    for k in range(80):
        loop.take(scan(2.0 * k, SCAN=float(k)), 2.0 * k)
        if loop.samples_until_estimate == 0:
            due.append(k)
            loop.request()
    assert due == [49, 59, 69, 79]


def test_the_request_carries_the_loops_settings() -> None:
    loop = pipeline()
    loop.take(scan(0.0), 0.0)
    request = loop.request()
    assert (request.loop, request.period, request.criterion) == ("FC101", 2.0, "auto")
    assert request.window.end_utc == 1000.0
