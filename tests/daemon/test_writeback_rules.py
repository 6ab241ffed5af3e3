"""When the write-back writes, and when it must not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from fieldlink.daemon.estimation.estimating import Findings, Interval
from fieldlink.daemon.writeback.outcomes import WritebackOutcome
from fieldlink.links.writable import WRITTEN_PARTS
from fieldlink.registers import (
    ExchangeLayout,
)
from fieldlink.site import WriteLimits
from loop_model import LoopModel
from tests.daemon.bench import Bench

Make = Callable[..., Findings]


async def test_without_the_enable_bit_not_a_single_register_is_written(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    device.words[layout.enable] = 0
    b = bench()
    b.submit(findings())
    await b.seconds(20)
    assert device.writes == []
    assert b.outcomes == [WritebackOutcome.NOT_ENABLED]
    device.words[layout.enable] = 1
    await b.seconds(5)
    assert b.outcomes[1:] == [WritebackOutcome.COMMITTED, WritebackOutcome.ACCEPTED]


async def test_read_only_sends_nothing_at_all(
    bench: Callable[..., Bench], findings: Make, device: Any
) -> None:
    b = bench(read_only=True)
    b.submit(findings())
    await b.seconds(10)
    assert device.requests == []
    assert b.outcomes == [WritebackOutcome.READ_ONLY]


async def test_a_change_within_the_deadband_is_not_written(
    bench: Callable[..., Bench], findings: Make
) -> None:
    b = bench(deadband=0.1)
    await b.write(findings(7.0, 4.0))
    b.submit(findings(7.09, 3.91))
    await b.seconds(5)
    assert b.outcomes[-1] is WritebackOutcome.UNCHANGED
    assert b.said[-1].why == f"deadband 0.1; {WritebackOutcome.UNCHANGED.advice}"
    await b.write(findings(7.0, 4.2))


@pytest.mark.parametrize("factor", [-1.0, 0.05])
async def test_another_gain_is_no_change_within_the_deadband(
    bench: Callable[..., Bench], findings: Make, factor: float
) -> None:
    b = bench(deadband=0.1)
    right = findings(7.0, 4.0)
    assert right.model is not None
    turned = replace(right.model.process, b=tuple(factor * v for v in right.model.process.b))
    await b.write(findings(7.0, 4.0, model=LoopModel(right.model.valve, turned)))
    await b.write(right)


async def test_a_block_is_renewed_before_it_expires(
    bench: Callable[..., Bench], findings: Make
) -> None:
    b = bench(valid_for=200)
    await b.write(findings(7.0))
    for _ in range(4):
        b.submit(findings(7.0))
        await b.seconds(80)
    assert b.plc.state.in_force is not None
    assert b.outcomes.count(WritebackOutcome.ACCEPTED) >= 3
    assert WritebackOutcome.UNCHANGED in b.outcomes


async def test_the_newest_findings_win_and_nothing_queues(
    bench: Callable[..., Bench], findings: Make
) -> None:
    b = bench(min_interval=60.0)
    b.submit(findings(5.0))
    await b.seconds(5)
    for stick_band in (6.0, 6.3, 6.6):
        b.submit(findings(stick_band))
        await b.seconds(3)
    assert b.outcomes[2:] == [
        WritebackOutcome.TOO_SOON,
        WritebackOutcome.SUPERSEDED,
        WritebackOutcome.TOO_SOON,
        WritebackOutcome.SUPERSEDED,
        WritebackOutcome.TOO_SOON,
    ]
    await b.seconds(60)
    assert b.plc.state.in_force.stick_band.value == pytest.approx(6.6)
    assert b.plc.state.ack_seq == 2


@pytest.mark.parametrize(
    ("stick_band", "slip_jump", "named"), [(12.0, 1.0, "stick_band"), (8.0, 6.0, "slip_jump")]
)
async def test_values_outside_the_limits_are_never_written(
    bench: Callable[..., Bench],
    findings: Make,
    device: Any,
    stick_band: float,
    slip_jump: float,
    named: str,
) -> None:
    b = bench(limits=WriteLimits(stick_band=(0.5, 10.0), slip_jump=(0.0, 5.0)))
    b.submit(findings(stick_band, slip_jump))
    await b.seconds(5)
    assert b.outcomes == [WritebackOutcome.OUT_OF_LIMITS]
    assert b.said[0].reason.startswith(f"no block is written: {named} ")
    assert "writeback.limits (" in b.said[0].reason
    assert not [w for w in device.writes if w[0] == 16]


async def test_windows_have_to_agree_first(bench: Callable[..., Bench], findings: Make) -> None:
    b = bench(min_windows=2)
    for stick_band in (5.0, 9.0, 9.2):
        b.submit(findings(stick_band))
    await b.seconds(5)
    assert b.outcomes == [
        WritebackOutcome.TOO_FEW_WINDOWS,
        WritebackOutcome.TOO_FEW_WINDOWS,
        WritebackOutcome.COMMITTED,
        WritebackOutcome.ACCEPTED,
    ]
    assert b.plc.state.in_force.windows == 2


@pytest.mark.parametrize("unsure_first", [False, True])
async def test_of_windows_that_agree_the_surest_is_written(
    bench: Callable[..., Bench], findings: Make, unsure_first: bool
) -> None:
    b = bench(min_windows=2)
    unsure = replace(findings(4.4, 1.3), stick_band=Interval(4.4, 0.8, 5.9))
    windows = [findings(8.0), unsure, findings(5.0, 1.5)]
    if not unsure_first:
        windows[1:] = reversed(windows[1:])
    for window in windows:
        b.submit(window)
    await b.seconds(5)
    written = b.plc.state.in_force
    assert written is not None
    # the one before them agrees with neither, however sure it is
    assert (written.valve.stick_band, written.valve.slip_jump) == (5.0, 1.5)
    assert (written.stick_band.high, written.windows) == (pytest.approx(5.1), 2)


@pytest.mark.parametrize("verdict", ["no_stiction", "not_assessable"])
async def test_a_calm_loop_does_not_end_its_own_compensation(
    bench: Callable[..., Bench], findings: Make, verdict: str
) -> None:
    b = bench(valid_for=600, min_interval=10.0)
    await b.write(findings(7.0, 4.0))
    b.submit(findings(verdict=verdict))
    await b.seconds(5)
    assert b.outcomes[-1] is WritebackOutcome.KEPT_VALID
    assert b.plc.state.in_force.valve.stick_band == 7.0
    await b.seconds(600)
    b.submit(findings(verdict=verdict))
    await b.seconds(5)
    assert b.outcomes[-1] is WritebackOutcome.ACCEPTED


async def test_findings_that_no_block_can_hold_are_refused(
    bench: Callable[..., Bench], findings: Make
) -> None:
    b = bench(limits=WriteLimits(stick_band=(0.0, 10.0)))
    b.submit(findings(0.0, 0.0))
    assert b.outcomes == [WritebackOutcome.NOT_EXPRESSIBLE]


async def test_the_plcs_own_registers_are_never_written(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench(min_interval=0.0)
    for stick_band in (5.0, 6.0, 7.0):
        b.submit(findings(stick_band))
        await b.seconds(6)
    written = {a + i for _, a, words in device.writes for i in range(len(words))}
    ours = {a for p, x, y in layout.spans() if p in WRITTEN_PARTS for a in range(x, y + 1)}
    assert written <= ours
    assert layout.enable not in written
