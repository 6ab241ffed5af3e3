"""A block is judged at the moment of writing, by the rules and findings of that moment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.registers import ExchangeLayout, Fallback, Refusal, Status
from fieldlink.site import WriteLimits
from tests.daemon.bench import Bench

Make = Callable[..., Findings]
Benches = Callable[..., Bench]


def banks_written(device: Any) -> list[int]:
    return [address for function, address, _ in device.writes if function == 16]


def commits(device: Any, layout: ExchangeLayout) -> list[int]:
    return [a for function, a, _ in device.writes if function == 6 and a == layout.commit]


async def test_newer_windows_that_say_otherwise_end_the_wait(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    device.words[layout.enable] = 0
    b = bench(min_windows=2)
    b.submit(findings(7.0))
    b.submit(findings(7.0))
    await b.seconds(4)
    for newer in (findings(15.0), findings(19.0), findings(verdict="no_stiction")):
        b.submit(newer)
        await b.seconds(4)
    assert b.outcomes.count(WritebackOutcome.CONTRADICTED) == 1
    device.words[layout.enable] = 1
    await b.seconds(10)
    assert banks_written(device) == []


async def test_a_finding_has_a_greatest_age(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    device.words[layout.enable] = 0
    b = bench(max_age=100.0)
    b.submit(findings(7.0))
    await b.seconds(90)
    assert b.writeback.waiting is not None
    await b.seconds(20)
    assert b.outcomes[-1] is WritebackOutcome.TOO_OLD
    device.words[layout.enable] = 1
    await b.seconds(10)
    assert banks_written(device) == []


@pytest.mark.parametrize(
    ("settings", "outcome"),
    [
        ({"limits": WriteLimits(stick_band=(0.0, 5.0))}, WritebackOutcome.OUT_OF_LIMITS),
        ({"min_windows": 3}, WritebackOutcome.TOO_FEW_WINDOWS),
    ],
)
async def test_what_waited_before_a_reload_is_judged_by_the_rules_after_it(
    bench: Benches,
    findings: Make,
    device: Any,
    layout: ExchangeLayout,
    settings: dict[str, Any],
    outcome: WritebackOutcome,
) -> None:
    device.words[layout.enable] = 0
    before = bench()
    before.submit(findings(18.0))
    await before.seconds(3)
    device.words[layout.enable] = 1
    after = bench(**settings)
    after.writeback.carry_over(before.writeback)
    await after.seconds(6)
    assert after.outcomes == [outcome]
    assert banks_written(device) == []


async def test_enable_is_read_again_between_bank_and_commit(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    def clear_after_bank() -> None:
        if device.writes[-1][0] == 16:
            device.words[layout.enable] = 0

    device.after_write = clear_after_bank
    b = bench(min_interval=0.0)
    b.submit(findings(7.0))
    await b.seconds(6)
    assert commits(device, layout) == []
    assert b.outcomes[0] is WritebackOutcome.NOT_ENABLED
    device.after_write = None
    device.words[layout.enable] = 1
    await b.seconds(6)
    assert b.plc.state.ack_seq == 2


async def test_a_refused_commit_stays_refused_and_gets_a_new_number(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    def clear_with_commit() -> None:
        if device.writes[-1][:2] == (6, layout.commit):
            device.words[layout.enable] = 0

    device.after_write = clear_with_commit
    b = bench(min_interval=0.0)
    b.submit(findings(7.0))
    await b.seconds(6)
    assert b.outcomes[:2] == [WritebackOutcome.COMMITTED, WritebackOutcome.REJECTED]
    device.after_write = None
    device.words[layout.enable] = 1
    b.plc.scan()
    assert b.plc.state.accepted is None
    await b.seconds(6)
    assert b.plc.state.ack_seq == 2
    assert b.plc.state.in_force.stick_band.value == 7.0


async def test_a_wrong_active_bank_is_not_believed(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench(min_interval=0.0)
    await b.write(findings(5.0))
    written = banks_written(device)
    device.words[layout.active_bank] = 0
    b.submit(findings(6.0))
    await b.seconds(6, scanning=False)
    assert banks_written(device) == written
    assert b.outcomes[-1] is WritebackOutcome.DISAGREES
    assert [kind for kind, _ in b.told] == ["writeback.disagrees"]
    device.words[layout.active_bank] = 1
    await b.seconds(6)
    assert b.plc.state.in_force.stick_band.value == 6.0


async def test_a_bank_that_another_client_has_spoilt_is_free_again_when_it_is_cleared(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench(min_interval=0.0)
    await b.write(findings(5.0))
    written = banks_written(device)
    device.words[layout.bank_b + 10 : layout.bank_b + 30] = [7] * 20
    b.submit(findings(6.0))
    await b.seconds(6)
    assert banks_written(device) == written
    ((kind, message),) = b.told
    assert kind == "writeback.disagrees"
    assert "bank B, which holds no block" in message
    assert "another client that writes to this area" in message
    device.words[layout.bank_b : layout.bank_b + 100] = [0] * 100
    await b.seconds(6)
    assert banks_written(device) == [*written, layout.bank_a]
    assert b.plc.state.in_force.stick_band.value == 6.0


async def test_a_window_under_compensation_never_replaces_the_block(
    bench: Benches, findings: Make
) -> None:
    b = bench(min_interval=0.0, valid_for=200)
    await b.write(findings(7.0))
    b.submit(findings(12.0), compensated=True)
    await b.seconds(4)
    assert b.outcomes[-1] is WritebackOutcome.CONTRADICTS_BLOCK
    assert [kind for kind, _ in b.told] == ["writeback.experiment_wanted"]
    assert b.plc.state.in_force.stick_band.value == 7.0
    await b.seconds(60)
    # One that agrees renews the block as it is: its own figures do not drift into it.
    b.submit(findings(7.3), compensated=True)
    await b.seconds(6)
    assert b.plc.state.ack_seq == 2
    assert b.plc.state.in_force.stick_band.value == 7.0


async def test_a_model_that_the_plc_refuses_is_not_offered_again(
    bench: Benches, findings: Make
) -> None:
    b = bench(min_interval=0.0)
    await b.write(findings(7.0))
    b.plc.refusal = Refusal.WORSE
    await b.seconds(4)
    assert [kind for kind, _ in b.told] == ["writeback.refused"]
    assert "PV got worse" in b.writeback.refusal
    b.submit(findings(7.05))
    await b.seconds(4)
    assert b.outcomes[-1] is WritebackOutcome.REFUSED_BEFORE
    b.submit(findings(9.0))
    await b.seconds(6)
    assert b.plc.state.in_force.stick_band.value == 9.0


@pytest.mark.parametrize("is_on_record", [True, False])
async def test_a_withdrawn_block_is_followed_by_none_until_the_operator_decides(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout, is_on_record: bool
) -> None:
    b = bench(min_interval=600.0)
    await b.write(findings(7.0))
    b.writeback.withdraw("the valve is being repaired", 0.0)
    await b.seconds(6)
    assert b.outcomes[-2:] == [WritebackOutcome.COMMITTED, WritebackOutcome.ACCEPTED]
    assert b.plc.state.in_force is None
    record = b.said[-1].record("FC101", 0.0)
    assert record.status == "withdrawn"
    assert "the valve is being repaired" in record.reason
    b.submit(findings(7.0))
    await b.seconds(6)
    assert b.outcomes[-1] is WritebackOutcome.HELD
    again = bench()
    if is_on_record:
        again.writeback.resume(record)
    again.submit(findings(7.0))
    await again.seconds(6)
    assert again.outcomes == [WritebackOutcome.HELD]
    device.words[layout.enable] = 0
    await again.seconds(4)
    device.words[layout.enable] = 1
    await again.seconds(4)
    again.submit(findings(7.0))
    await again.seconds(6)
    assert again.plc.state.in_force.status is Status.VALID


async def test_a_block_whose_bank_the_plc_has_cleared_is_written_again(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench()
    await b.write(findings(7.0))
    device.words[layout.bank_a : layout.bank_b + 100] = [0] * (layout.bank_b + 100 - layout.bank_a)
    await b.seconds(4)
    assert b.plc.state.fallback is Fallback.CLEARED
    b.submit(findings(7.0), compensated=True)
    await b.seconds(4)
    assert b.outcomes[-1] is WritebackOutcome.CONTRADICTS_BLOCK
    assert (b.writeback.compensates, b.told) == (False, [])
    b.submit(findings(7.0))
    await b.seconds(6)
    assert b.plc.state.in_force.stick_band.value == 7.0


async def test_what_the_estimator_doubts_is_not_written(
    bench: Benches, findings: Make, device: Any
) -> None:
    b = bench()
    b.submit(replace(findings(7.0), uncertain=True))
    await b.seconds(4)
    assert b.outcomes == [WritebackOutcome.UNCERTAIN]
    assert banks_written(device) == []


@pytest.mark.parametrize("identities", [(11, 22), (11, 11)], ids=["two", "one copied"])
async def test_two_installations_notice_each_other_and_write_no_block(
    bench: Benches, findings: Make, device: Any, identities: tuple[int, int]
) -> None:
    first, second = (bench(identity=identity, min_interval=0.0) for identity in identities)
    await first.seconds(3)
    for _ in range(12):
        await first.seconds(1)
        await second.seconds(1)
    for writer in (first, second):
        writer.submit(findings(7.0))
        await writer.seconds(4)
        assert writer.outcomes[-1] is WritebackOutcome.CONTESTED
        assert "writeback.contested" in [kind for kind, _ in writer.told]
    assert banks_written(device) == []


async def test_an_installation_takes_the_place_of_one_that_is_gone(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    gone = bench(identity=11)
    await gone.seconds(4)
    b = bench(identity=22)
    b.submit(findings(7.0))
    await b.seconds(8)
    assert banks_written(device) == []
    await b.seconds(10)
    assert b.plc.state.in_force.stick_band.value == 7.0
    assert device.words[layout.writer or 0] == 22


async def test_a_number_of_an_attempt_that_came_to_nothing_is_not_given_again(
    bench: Benches, findings: Make
) -> None:
    b = bench()
    b.submit(findings(7.0))
    await b.seconds(1)
    attempt: Attempt = b.said[0].became(WritebackOutcome.INTERRUPTED, "")
    b.plc.words[100:320] = [0] * 220
    b.plc.words[100] = 1
    again = bench()
    again.writeback.resume(attempt.record("FC101", 0.0))
    again.submit(findings(7.0))
    await again.seconds(1)
    assert [a.block.seq for a in again.said if a.block] == [2]
