"""What the write-back does when a step fails: nothing half done, and tried again."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from typing import Any

import pytest

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.writeback.exchange_io import ControlWords
from fieldlink.daemon.writeback.outcomes import WritebackOutcome
from fieldlink.daemon.writeback.sole_writer import SoleWriter, Standing
from fieldlink.registers import (
    ACCEPTED,
    BLOCK_REGISTERS,
    Bank,
    BlockLimits,
    BlockReader,
    ExchangeLayout,
    Fallback,
)
from tests.daemon.bench import Bench

Make = Callable[..., Findings]


def bank_of(device: Any, layout: ExchangeLayout, bank: Bank) -> list[int]:
    start = layout.bank_address(bank)
    return list(device.words[start : start + BLOCK_REGISTERS])


async def test_a_corrupted_read_back_is_never_committed(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench()
    await b.write(findings(5.0))
    active = bank_of(device, layout, Bank.B)
    commit = device.words[layout.commit]
    device.after_write = lambda: device.words.__setitem__(layout.bank_a + 20, 0xDEAD)
    b.submit(findings(6.0))
    await b.seconds(3)
    assert b.outcomes[-1] is WritebackOutcome.READBACK_DIFFERS
    assert "offset 20" in b.said[-1].reason
    assert bank_of(device, layout, Bank.B) == active
    assert device.words[layout.commit] == commit
    assert b.plc.state.in_force.stick_band.value == 5.0

    device.after_write = None
    await b.seconds(40)
    assert b.outcomes[-2:] == [WritebackOutcome.COMMITTED, WritebackOutcome.ACCEPTED]
    assert b.plc.state.in_force.stick_band.value == 6.0


async def test_a_read_back_is_repeated_after_a_scan_before_it_counts(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    right: list[int] = []

    def not_yet() -> None:
        if device.writes[-1][0] == 16:
            right.append(device.words[layout.bank_b + 5])
            device.words[layout.bank_b + 5] ^= 1

    async def a_scan_later() -> None:
        device.words[layout.bank_b + 5] = right[-1]

    device.after_write = not_yet
    b = bench(pause=a_scan_later)
    b.submit(findings())
    await b.seconds(5)
    assert b.outcomes == [WritebackOutcome.COMMITTED, WritebackOutcome.ACCEPTED]


async def test_a_refused_write_changes_nothing_and_is_tried_later(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench(min_interval=0.0)
    b.submit(findings())
    real = device._answer

    def refuse_block(body: bytes) -> bytes:
        return bytes([0x90, 4]) if body[0] == 16 else bytes(real(body))

    device._answer = refuse_block
    await b.seconds(1)
    assert b.outcomes == [WritebackOutcome.WRITE_FAILED]
    assert "exception 4" in b.said[0].reason
    assert device.words[layout.commit] == 0
    device._answer = real
    await b.seconds(5)
    assert b.outcomes[-1] is WritebackOutcome.ACCEPTED


async def test_a_commit_without_an_answer_is_settled_by_the_acknowledgement(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench()

    def lose_answer(frame: bytes) -> bytes:
        lost = device.requests[-1][:2] == (6, layout.commit)
        return b"" if lost else frame

    device.tamper = lose_answer
    b.submit(findings())
    await b.seconds(5)
    assert b.outcomes == [WritebackOutcome.COMMIT_FAILED, WritebackOutcome.ACCEPTED]
    assert [a for f, a, _ in device.writes if f == 16] == [layout.bank_b]


async def test_a_rejection_names_the_plcs_reason(
    bench: Callable[..., Bench], findings: Make, plc: Any
) -> None:
    plc.reader = BlockReader(101, limits=BlockLimits(stick_band=(0.0, 3.0)))
    b = bench()
    b.submit(findings(7.0))
    await b.seconds(5)
    assert b.outcomes == [WritebackOutcome.COMMITTED, WritebackOutcome.REJECTED]
    assert "outside its range" in b.said[-1].reason


async def test_a_plc_that_does_not_acknowledge_is_reported(
    bench: Callable[..., Bench], findings: Make
) -> None:
    b = bench()
    b.submit(findings())
    await b.seconds(15, scanning=False)
    assert b.outcomes == [WritebackOutcome.COMMITTED, WritebackOutcome.NOT_ACKNOWLEDGED]
    assert "commit register" not in b.said[-1].reason


async def test_a_commit_register_that_keeps_nothing_is_named(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench()
    device.after_write = lambda: device.words.__setitem__(layout.commit, 0)
    b.submit(findings())
    await b.seconds(15)
    assert b.outcomes == [WritebackOutcome.COMMITTED, WritebackOutcome.NOT_ACKNOWLEDGED]
    assert "the commit register holds 0x0000 instead of 0x0101 as written" in b.said[-1].reason


@pytest.mark.parametrize("is_restarted", [False, True])
async def test_a_withdrawal_whose_commit_is_lost_is_written_again(
    bench: Callable[..., Bench],
    findings: Make,
    device: Any,
    layout: ExchangeLayout,
    is_restarted: bool,
) -> None:
    """Else the block that an operator has withdrawn stays in force until it expires."""
    b = bench(min_interval=20.0)
    await b.write(findings(7.0))
    active = device.words[layout.commit]
    b.writeback.withdraw("the valve is being repaired", 0.0)
    await b.seconds(2, scanning=False)
    assert device.words[layout.commit] != active
    # as a gateway that has answered for the PLC and not passed it on
    device.words[layout.commit] = active
    await b.seconds(15)
    assert b.outcomes[-1] in (WritebackOutcome.NOT_ACKNOWLEDGED, WritebackOutcome.TOO_SOON)
    assert b.plc.state.in_force is not None
    if is_restarted:
        lost = [a for a in b.said if a.outcome is WritebackOutcome.NOT_ACKNOWLEDGED]
        b = bench(min_interval=20.0)
        b.writeback.resume(lost[-1].record("FC101", 0.0))
    await b.seconds(20)
    assert b.outcomes[-2:] == [WritebackOutcome.COMMITTED, WritebackOutcome.ACCEPTED]
    assert b.plc.state.in_force is None


async def test_a_rejected_withdrawal_is_written_again_until_an_operator_decides(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench(min_interval=10.0)
    await b.write(findings(7.0))
    b.plc.reader = BlockReader(102)
    b.writeback.withdraw("the valve is being repaired", 0.0)
    await b.seconds(30)
    assert b.outcomes.count(WritebackOutcome.REJECTED) >= 2
    device.words[layout.enable] = 0
    await b.seconds(4)
    device.words[layout.enable] = 1
    await b.seconds(4)
    tries = b.outcomes.count(WritebackOutcome.COMMITTED)
    await b.seconds(30)
    assert b.outcomes.count(WritebackOutcome.COMMITTED) == tries
    assert b.writeback.waiting is None


async def test_a_heartbeat_register_that_keeps_nothing_means_no_compensation(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    """Else windows without compensation are judged as if it were there, and never written."""
    b = bench(min_interval=10.0)
    b.submit(findings(7.0))
    for _ in range(40):
        await b.seconds(1, scanning=False)
        device.words[layout.heartbeat] = 0
        b.plc.scan()
    assert b.plc.state.fallback is Fallback.HEARTBEAT_DEAD
    assert b.writeback.compensates is False
    ((kind, said),) = b.told
    assert kind == "writeback.heartbeat_lost"
    assert "does not keep what is written" in said
    await b.seconds(6)
    assert b.plc.state.fallback is None
    assert b.writeback.compensates is True


def test_a_heartbeat_that_a_second_writer_counts_up_is_not_said_to_stand_still() -> None:
    """A copied data directory: two daemons with one identity. The PLC sees a living heartbeat."""
    writers = [SoleWriter(7), SoleWriter(7)]
    words = ControlWords(
        enable=1, ack_seq=1, ack_result=1, active_bank=1, ack_commit=257, heartbeat=5, commit=257,
        writer=7,
    )  # fmt: skip
    for k in range(60):
        writer = writers[k % 2]
        writer.look(words, 0.5 * k)
        words = replace(words, heartbeat=writer.next_beat(words))
    assert [writer.standing for writer in writers] == [Standing.CONTESTED] * 2
    assert not any(writer.is_unheard(30.0) for writer in writers)
    for k in range(60, 90):
        writers[0].look(words, 0.5 * k)
        writers[0].next_beat(words)
    assert writers[0].is_unheard(45.0)


async def test_an_answer_that_names_the_other_bank_accepts_nothing(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench()
    b.submit(findings())
    await b.seconds(1, scanning=False)
    # as a PLC would whose program mixes its banks up: right number and result, the old bank
    for _ in range(15):
        commit = device.words[layout.commit]
        device.words[layout.ack_seq], device.words[layout.ack_commit] = commit & 0xFF, commit
        device.words[layout.ack_result], device.words[layout.active_bank] = ACCEPTED, 0
        await b.seconds(1, scanning=False)
    assert b.outcomes == [WritebackOutcome.COMMITTED, WritebackOutcome.NOT_ACKNOWLEDGED]
    assert "ack_seq is 1, active_bank 0" in b.said[-1].reason
    assert b.writeback.block is None
    assert not b.writeback.compensates


async def test_findings_wait_while_the_device_is_away(
    bench: Callable[..., Bench], findings: Make, device: Any
) -> None:
    b = bench()
    await device.stop()
    b.submit(findings())
    await b.seconds(6)
    assert b.outcomes == [WritebackOutcome.UNREACHABLE]
    assert b.errors
    await device.start()
    await b.seconds(6)
    assert b.outcomes[1:] == [WritebackOutcome.COMMITTED, WritebackOutcome.ACCEPTED]


async def test_what_waits_tells_why_the_attempt_before_failed(
    bench: Callable[..., Bench], findings: Make, device: Any
) -> None:
    b = bench(min_interval=60.0)
    b.submit(findings(5.0))
    real = device._answer

    def refuse_block(body: bytes) -> bytes:
        return bytes([0x90, 4]) if body[0] == 16 else bytes(real(body))

    device._answer = refuse_block
    await b.seconds(5)
    assert b.outcomes == [WritebackOutcome.WRITE_FAILED, WritebackOutcome.TOO_SOON]
    assert "s left; the attempt before: write_failed, " in b.said[-1].reason
    assert "exception 4" in b.said[-1].reason
    assert "exception 4" in str(b.writeback.waiting)

    device._answer = real
    await b.seconds(40)
    assert b.outcomes[-1] is WritebackOutcome.ACCEPTED
    b.submit(findings(9.0))
    await b.seconds(3)
    assert b.outcomes[-1] is WritebackOutcome.TOO_SOON
    assert "exception" not in b.said[-1].reason


async def test_banks_that_do_not_answer_are_asked_for_now_and_then(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    def lose_bank(frame: bytes) -> bytes:
        return b"" if device.requests[-1][1:] == (layout.bank_a, BLOCK_REGISTERS) else frame

    b = bench(min_interval=60.0)
    device.tamper = lose_bank
    b.submit(findings(5.0))
    await b.seconds(61)
    asked = [address for _, address, _ in device.requests].count(layout.bank_a)
    # Three times in a minute; a read that ends a connection is repeated once.
    assert asked <= 2 * 3
    assert "the attempt before: unreachable" in str(b.writeback.waiting)
    # The heartbeat goes on meanwhile.
    assert sum(address == layout.heartbeat for _, address, _ in device.writes) >= 30


@pytest.mark.parametrize(
    ("function", "code", "said"),
    [
        (16, 3, f"a block is written as {BLOCK_REGISTERS} registers in one request (FC16)"),
        (16, 1, f"a block is written as {BLOCK_REGISTERS} registers in one request (FC16)"),
        (6, 1, "heartbeat, writer and commit are written one register at a time (FC6)"),
    ],
)
async def test_a_function_that_the_plc_does_not_take_is_named(
    bench: Callable[..., Bench], findings: Make, device: Any, function: int, code: int, said: str
) -> None:
    b = bench(min_interval=0.0)
    real = device._answer
    device._answer = lambda body: (
        bytes([function | 0x80, code]) if body[0] == function else real(body)
    )
    b.submit(findings())
    await b.seconds(10)
    assert any(said in one.reason for one in b.said)
    assert WritebackOutcome.COMMITTED not in b.outcomes
    device._answer = real
    await b.seconds(40)
    assert b.outcomes[-1] is WritebackOutcome.ACCEPTED


async def test_a_block_that_waits_for_a_silent_plc_says_so(
    bench: Callable[..., Bench], findings: Make, device: Any
) -> None:
    receipt: Future[bool] = Future()
    b = bench(min_interval=0.0, keep=lambda _: receipt)
    b.submit(findings())
    await b.seconds(1)
    assert b.writeback.waiting == "its row is being stored"
    receipt.set_result(True)
    device.exception = 6
    await b.seconds(4)
    assert b.writeback.waiting.startswith("it is written when the exchange area answers again: ")
    device.exception = None
    await b.seconds(10)
    assert b.outcomes[-1] is WritebackOutcome.ACCEPTED


async def test_an_exchange_area_that_the_plc_has_not_names_its_keys(
    bench: Callable[..., Bench], findings: Make, device: Any
) -> None:
    """The map was named, in which these registers are not."""
    b = bench(min_interval=0.0)
    device.exception = 2
    b.submit(findings())
    await b.seconds(4)
    reason = b.said[-1].reason
    assert "correct the loop's writeback.base or writeback.addresses" in reason
    assert "map" not in reason


async def test_a_refusal_of_another_release_is_named_by_its_number(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench()
    await b.write(findings())
    device.words[layout.ack_refusal] = 99
    await b.seconds(4, scanning=False)
    ((kind, message),) = b.told
    assert kind == "writeback.refused"
    assert "refusal code 99, which is not one of ours" in message
