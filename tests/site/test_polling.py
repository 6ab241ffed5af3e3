"""How often a device is polled, and which loops each poll serves."""

from __future__ import annotations

import pytest

from fieldlink.registers import DataType, Table, Tag, plan_reads
from fieldlink.site import Loop
from fieldlink.site.polling import poll_period, polls_by_tag


def loop_of(period: float, scan: str | None = None, name: str = "", **rest: str) -> Loop:
    tags = {"op": f"{name}OP", "pv": f"{name}PV"} | rest
    return Loop(device="plc", period=period, scan=scan, **tags)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("loops", "seconds"),
    [
        ([loop_of(1.0)], 1.0),
        ([loop_of(1.0, "SCAN")], 0.5),
        ([loop_of(1.0), loop_of(5.0)], 1.0),
        ([loop_of(2.0), loop_of(3.0)], 1.0),
        ([loop_of(1.0), loop_of(1.07)], 0.5),
    ],
)
def test_one_poll_period_serves_all_loops(loops: list[Loop], seconds: float) -> None:
    assert poll_period(loops) == seconds


def test_a_loop_is_read_in_as_few_polls_as_its_period_allows() -> None:
    loops = [loop_of(1.0, name="A"), loop_of(5.0, name="B"), loop_of(4.0, "C.SCAN", name="C")]
    assert polls_by_tag(loops) == {
        "AOP": 1, "APV": 1, "BOP": 5, "BPV": 5, "COP": 2, "CPV": 2, "C.SCAN": 2,
    }  # fmt: skip


def test_loops_that_share_a_tag_are_read_together() -> None:
    loops = [loop_of(1.0, name="A", mode="M"), loop_of(5.0, name="B", mode="M", sp="S"),
             loop_of(10.0, name="C", sp="S")]  # fmt: skip
    assert set(polls_by_tag(loops).values()) == {1}


def test_a_period_that_does_not_fit_is_read_in_every_poll() -> None:
    assert polls_by_tag([loop_of(1.0, name="A"), loop_of(1.07, name="B")])["BOP"] == 1


def test_tags_of_different_polls_never_share_a_request() -> None:
    tags = [Tag(f"T{i}", Table.HOLDING, 2 * i, DataType.FLOAT32) for i in range(4)]
    plan = plan_reads(tags, polls={"T1": 5, "T2": 5})
    assert [(request.polls, [tag.name for tag in request.tags]) for request in plan] == [
        (1, ["T0", "T3"]),
        (5, ["T1", "T2"]),
    ]
