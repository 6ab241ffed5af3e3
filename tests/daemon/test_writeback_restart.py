"""A block is on record before it is written, and its record is completed after a kill."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.site_runner import SiteRunner
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.links import SystemClock
from fieldlink.registers import (
    BLOCK_REGISTERS,
    ExchangeLayout,
)
from fieldlink.store import EventRecord, Historian, WritebackRecord
from tests.daemon.bench import Bench

Make = Callable[..., Findings]


@pytest.mark.parametrize(("acknowledged", "following"), [(7, 8), (65535, 1)])
async def test_after_a_restart_the_sequence_goes_on_from_the_acknowledged_one(
    bench: Callable[..., Bench], findings: Make, plc: Any, acknowledged: int, following: int
) -> None:
    before = bench(last_seq=acknowledged - 1)
    await before.write(findings(5.0))
    assert plc.state.ack_seq == acknowledged
    after = bench()
    # A window of before may have been compensated: it confirms the block, under a new number.
    await after.write(findings(5.1))
    assert plc.state.ack_seq == following
    assert plc.state.in_force.stick_band.value == 5.0


def recorder() -> tuple[list[Attempt], Callable[[Attempt], Future[bool]], Future[bool]]:
    """A store that keeps a row when it is told to."""
    rows: list[Attempt] = []
    receipt: Future[bool] = Future()

    def keep(attempt: Attempt) -> Future[bool]:
        rows.append(attempt)
        return receipt

    return rows, keep, receipt


async def test_nothing_is_written_before_its_row_is_stored(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    rows, keep, receipt = recorder()
    b = bench(keep=keep)
    b.submit(findings(7.0))
    await b.seconds(10)
    assert [row.outcome for row in rows] == [WritebackOutcome.BEGUN]
    assert {address for _, address, _ in device.writes} == {layout.heartbeat}
    receipt.set_result(True)
    await b.seconds(5)
    assert b.outcomes == [WritebackOutcome.COMMITTED, WritebackOutcome.ACCEPTED]
    assert b.said[0].words == rows[0].words


async def test_a_store_that_cannot_be_written_is_waited_for(
    bench: Callable[..., Bench], findings: Make, device: Any
) -> None:
    _, keep, receipt = recorder()
    b = bench(keep=keep, min_interval=0.0)
    b.submit(findings(7.0))
    await b.seconds(100)
    assert b.outcomes == [WritebackOutcome.NOT_RECORDED]
    receipt.set_result(False)
    await b.seconds(3)
    assert b.outcomes[1:] == [WritebackOutcome.NOT_RECORDED] * len(b.outcomes[1:])
    assert not [write for write in device.writes if write[0] == 16]


async def test_the_enable_bit_counts_when_the_row_is_stored(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    _, keep, receipt = recorder()
    b = bench(keep=keep)
    b.submit(findings(7.0))
    await b.seconds(3)
    device.words[layout.enable] = 0
    receipt.set_result(True)
    await b.seconds(5)
    assert b.outcomes == [WritebackOutcome.NOT_ENABLED]
    assert not [write for write in device.writes if write[0] == 16]


async def test_a_block_that_was_committed_when_the_daemon_was_killed_gets_its_rows(
    bench: Callable[..., Bench], findings: Make
) -> None:
    rows: list[Attempt] = []
    receipt: Future[bool] = Future()
    receipt.set_result(True)
    before = bench(keep=lambda attempt: rows.append(attempt) or receipt)
    before.submit(findings(7.0))
    await before.seconds(1)
    assert before.outcomes == [WritebackOutcome.COMMITTED]

    after = bench()
    after.writeback.resume(rows[0].record("FC101", 1.0))
    await after.seconds(5)
    assert after.outcomes == [WritebackOutcome.COMMITTED, WritebackOutcome.ACCEPTED]
    assert "started again" in after.said[0].reason
    assert [attempt.words for attempt in after.said] == [rows[0].words] * 2
    assert after.said[1].candidate.findings.stick_band.value == 7.0


async def test_a_block_whose_acknowledgement_was_not_stored_gets_it_once(
    bench: Callable[..., Bench], findings: Make
) -> None:
    before = bench()
    before.submit(findings(7.0))
    await before.seconds(5)
    committed = before.said[0].record("FC101", 1.0)

    after = bench()
    after.writeback.resume(committed)
    await after.seconds(5)
    assert after.outcomes == [WritebackOutcome.ACCEPTED]


@pytest.mark.parametrize(("written", "said"), [(True, "whole"), (False, "not there")])
async def test_a_block_that_was_never_committed_is_said_to_be_interrupted(
    bench: Callable[..., Bench],
    findings: Make,
    device: Any,
    layout: ExchangeLayout,
    written: bool,
    said: str,
) -> None:
    rows, keep, _ = recorder()
    before = bench(keep=keep)
    before.submit(findings(7.0))
    await before.seconds(1)
    (begun,) = rows
    assert begun.words is not None
    if written:
        device.words[layout.bank_b : layout.bank_b + BLOCK_REGISTERS] = begun.words

    after = bench()
    after.writeback.resume(begun.record("FC101", 1.0))
    await after.seconds(3)
    assert after.outcomes == [WritebackOutcome.INTERRUPTED]
    assert f"the block is {said};" in after.said[0].reason
    assert after.plc.state.in_force is None
    # Its number is not used again.
    await after.write(findings(8.0))
    assert after.plc.state.ack_seq == 2


async def test_what_was_started_is_looked_for_until_the_device_answers(
    bench: Callable[..., Bench], findings: Make, device: Any
) -> None:
    before = bench()
    before.submit(findings(7.0))
    await before.seconds(5)
    begun = replace(before.said[0], outcome=WritebackOutcome.BEGUN).record("FC101", 1.0)
    await device.stop()
    after = bench()
    after.writeback.resume(begun)
    await after.seconds(4)
    assert after.outcomes == []
    await device.start()
    await after.seconds(5)
    assert after.outcomes == [WritebackOutcome.COMMITTED, WritebackOutcome.ACCEPTED]


async def test_a_block_that_cannot_be_told_at_the_first_look_is_told_at_a_later_one(
    bench: Callable[..., Bench], findings: Make, plc: Any, layout: ExchangeLayout
) -> None:
    """Else its loop would count as uncompensated, and its block as one to be replaced."""
    await bench().write(findings(7.0))
    after = bench()
    plc.words[layout.active_bank] ^= 1
    await after.seconds(4, scanning=False)
    plc.words[layout.active_bank] ^= 1
    await after.seconds(4)
    assert after.writeback.block is not None
    assert after.writeback.may_compensate
    after.submit(findings(verdict="no_stiction"), compensated=after.writeback.may_compensate)
    await after.seconds(70)
    assert after.outcomes == [WritebackOutcome.KEPT_VALID]
    assert plc.state.in_force.stick_band.value == 7.0


async def test_a_window_from_before_the_block_could_be_told_may_have_been_compensated(
    bench: Callable[..., Bench], findings: Make, plc: Any, layout: ExchangeLayout
) -> None:
    await bench().write(findings(7.0))
    after = bench()
    plc.words[layout.active_bank] ^= 1
    await after.seconds(2, scanning=False)
    after.submit(findings(15.0), compensated=after.writeback.may_compensate)
    plc.words[layout.active_bank] ^= 1
    await after.seconds(70)
    assert after.outcomes[-1] is WritebackOutcome.CONTRADICTS_BLOCK
    assert plc.state.in_force.stick_band.value == 7.0


WITHDRAWN, VALID = "withdrawn", "valid"
WRITEBACK = """
[loops.LOOP.writeback]
enabled = true
loop_id = 101
base = 100
"""


@pytest.mark.parametrize(
    ("rows", "waiting"),
    [
        ([], True),
        ([(8, VALID, "accepted")], True),
        ([(9, WITHDRAWN, "begun"), (9, WITHDRAWN, "write_failed")], True),
        ([(9, WITHDRAWN, "begun"), (9, WITHDRAWN, "interrupted")], True),
        ([(9, WITHDRAWN, "committed"), (9, WITHDRAWN, "rejected")], True),
        ([(9, WITHDRAWN, "not_acknowledged"), (10, WITHDRAWN, "write_failed")], True),
        ([(9, WITHDRAWN, "begun"), (9, WITHDRAWN, "accepted")], False),
        ([(9, WITHDRAWN, "accepted"), (10, VALID, "begun"), (10, VALID, "write_failed")], False),
        # Looked for in the PLC first.
        ([(9, WITHDRAWN, "begun")], False),
        ([(9, WITHDRAWN, "committed"), (9, WITHDRAWN, "not_acknowledged")], False),
    ],
)
async def test_a_withdrawal_that_the_plc_had_not_got_outlives_the_daemon(
    tmp_path: Path, live: Any, rows: list[tuple[int, str, str]], waiting: bool
) -> None:
    """Else its block stays in force, and the next window writes another one."""
    site = live.site_for(tmp_path, {"plc": 502}, WRITEBACK)
    historian = Historian(site.historian_url, live.STORE)
    before = SiteRunner(site, SystemClock(), historian.put).loop("PLC")
    assert before is not None
    historian.start(EventRecord(0, "daemon.start", "daemon", ""))
    before.numbers.learn(8)
    before.withdraw("the valve is being repaired", 1.0)
    for seq, status, outcome in rows:
        # The wall clock has been set back meanwhile.
        historian.put(WritebackRecord("PLC", 0, outcome, "", seq, "A", status))
    historian.stop()
    after = SiteRunner(site, SystemClock(), lambda _: None)
    await after.resume_from(site.historian_url)
    loop = after.loop("PLC")
    assert loop is not None
    said = loop.status("plc").waiting
    assert (said is not None and said.startswith("withdrawn: ")) is waiting
