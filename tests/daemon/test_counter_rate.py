"""A cycle counter that does not count once a period: the only sign of a wrong `period`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.loop import LoopRunner
from fieldlink.daemon.loop_spec import LoopSpec
from fieldlink.daemon.writeback.outcomes import WritebackOutcome
from fieldlink.daemon.writeback.sequence import SequenceNumbers
from fieldlink.links import Quality, Reading, Scan
from fieldlink.registers import DataType, Table, Tag
from fieldlink.site import Device, Loop
from tests.daemon.bench import Bench

TAGS = {
    "OP": Tag("OP", Table.HOLDING, 0, DataType.FLOAT32),
    "PV": Tag("PV", Table.HOLDING, 2, DataType.FLOAT32),
    "SCAN": Tag("SCAN", Table.HOLDING, 4, DataType.UINT16),
}


class Events:
    """Takes the events of a loop that are of its period."""

    def __init__(self) -> None:
        self.kinds: list[str] = []
        self.messages: list[str] = []

    def sample(self, record: Any) -> None:
        """Samples are of no interest here."""

    def event(self, kind: str, source: str, message: str, *, bad: bool = False) -> None:
        assert source == "FC101"
        if "period" in kind:
            assert bad is (kind == "loop.wrong_period")
            self.kinds.append(kind)
            self.messages.append(message)


def runner(events: Any, **device: Any) -> LoopRunner:
    """A loop with a period of 1 s."""
    loop = Loop(device="plc", op="OP", pv="PV", scan="SCAN", period=1.0)
    plc = Device(link="modbus-tcp", host="127.0.0.1", register_map="map.csv", **device)
    spec = LoopSpec("FC101", loop, plc, TAGS, plc.speed)
    nowhere: Any = None
    return LoopRunner(spec, nowhere, events, numbers=SequenceNumbers())


def poll(loop: LoopRunner, moments: Iterable[float], every: float, first: int = 0) -> int:
    """Poll at ``moments`` a controller that counts every so many seconds; return the last count."""
    moments, count = list(moments), first
    for at in moments:
        count = first + int((at - moments[0]) / every + 1e-6)
        values = {"OP": 50.0, "PV": 7.0, "SCAN": float(count & 0xFFFF)}
        readings = {tag: Reading(value, Quality.GOOD, at, at) for tag, value in values.items()}
        loop.take(Scan(readings, at, at), at, at, answers=True)
    return count


def halves(first: int, last: int) -> list[float]:
    """Twice a period, as a device is polled."""
    return [0.5 * k for k in range(2 * first, 2 * last)]


@pytest.mark.parametrize("every", [2.0, 1.5, 0.5, 0.1])
def test_a_counter_of_another_rate_is_told_once_with_what_it_counts(every: float) -> None:
    events = Events()
    loop = runner(events)
    poll(loop, halves(0, 90), every)
    assert events.kinds == []
    poll(loop, halves(90, 400), every, first=1000)
    assert events.kinds == ["loop.wrong_period"]
    assert f"SCAN counts every {every:g} s, not every 1 s" in events.messages[0]
    assert "correct the loop's period" in events.messages[0]
    assert "SCAN counts every" in loop.status("plc").fault


@pytest.mark.parametrize("every", [0.95, 1.0, 1.1])
def test_a_controller_a_little_off_its_period_is_right(every: float) -> None:
    events = Events()
    poll(runner(events), halves(0, 400), every)
    assert events.kinds == []


def test_a_controller_that_stood_still_is_right_and_one_set_right_is_told() -> None:
    events = Events()
    loop = runner(events)
    count = poll(loop, halves(0, 130), 1.0)
    count = poll(loop, halves(190, 330), 1.0, first=count)  # a minute without a count
    assert events.kinds == []
    count = poll(loop, halves(330, 600), 2.0, first=count)
    assert events.kinds == ["loop.wrong_period"]
    poll(loop, halves(600, 760), 1.0, first=count)
    assert events.kinds == ["loop.wrong_period", "loop.right_period"]
    assert loop.status("plc").fault == ""


@pytest.mark.parametrize("device", [{"speed": 20.0}, {"pace": "plant"}])
def test_a_simulated_plant_that_falls_behind_the_clock_is_not_blamed(device: Any) -> None:
    events = Events()
    poll(runner(events, **device), halves(0, 400), 2.0)
    assert events.kinds == []


async def test_no_model_is_written_while_its_time_is_wrong(
    bench: Callable[..., Bench], findings: Callable[..., Findings], device: Any
) -> None:
    b = bench()
    b.writeback.mistrust_time("SCAN counts every 2 s, not every 1 s")
    b.submit(findings(7.0))
    await b.seconds(30)
    assert b.outcomes == [WritebackOutcome.WRONG_PERIOD]
    assert "SCAN counts every 2 s" in b.said[0].why
    assert [write for write in device.writes if write[0] == 16] == []
    b.writeback.mistrust_time("")
    await b.write(findings(7.0))


async def test_a_block_that_waits_is_given_up_when_its_time_turns_out_wrong(
    bench: Callable[..., Bench], findings: Callable[..., Findings], device: Any, layout: Any
) -> None:
    device.words[layout.enable] = 0
    b = bench()
    b.submit(findings(7.0))
    await b.seconds(10)
    b.writeback.mistrust_time("SCAN counts every 2 s, not every 1 s")
    device.words[layout.enable] = 1
    await b.seconds(30)
    assert b.outcomes[-1] is WritebackOutcome.WRONG_PERIOD
    assert [write for write in device.writes if write[0] == 16] == []
    # An operator's withdrawal says nothing of time.
    b.writeback.withdraw("valve replaced", 0.0)
    await b.seconds(10)
    assert WritebackOutcome.ACCEPTED in b.outcomes
