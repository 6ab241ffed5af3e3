"""The write-back over a real socket: what the PLC gets, and how it is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.writeback.exchange_io import Exchange
from fieldlink.daemon.writeback.outcomes import WritebackOutcome
from fieldlink.links import ExceptionReplyError
from fieldlink.registers import (
    Bank,
    BlockReader,
    ExchangeLayout,
    Status,
)
from tests.daemon.bench import WINDOW_END, Bench

Make = Callable[..., Findings]


async def test_findings_become_the_block_that_the_plc_uses(
    bench: Callable[..., Bench], findings: Make
) -> None:
    b = bench(valid_for=3600)
    b.submit(findings(7.0, 4.0))
    await b.seconds(5)
    assert b.outcomes == [WritebackOutcome.COMMITTED, WritebackOutcome.ACCEPTED]
    block = b.plc.state.in_force
    assert block.status is Status.VALID
    assert (block.seq, block.loop_id, block.valid_for) == (1, 101, 3600)
    assert (block.valve.stick_band, block.valve.slip_jump) == (7.0, 4.0)
    assert block.stick_band.low == pytest.approx(6.86, rel=1e-6)
    assert block.window_end_ms == round(WINDOW_END * 1000)
    assert b.plc.state.model.process.a == pytest.approx((-0.9,))


async def test_one_block_is_one_request_read_back_and_one_commit(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench()
    b.submit(findings())
    await b.seconds(1)
    writes = [(function, address) for function, address, _ in device.writes]
    assert writes == [(6, layout.heartbeat), (16, layout.bank_b), (6, layout.commit)]
    assert [(function, address) for function, address, _ in device.requests[-4:]] == [
        (16, layout.bank_b),
        (3, layout.bank_b),
        (3, layout.enable),
        (6, layout.commit),
    ]


async def test_banks_alternate_and_the_sequence_counts(
    bench: Callable[..., Bench], findings: Make
) -> None:
    b = bench()
    for stick_band in (5.0, 6.0, 7.0, 8.0):
        await b.write(findings(stick_band))
        assert b.plc.state.in_force.stick_band.value == stick_band
    written = [a for a in b.said if a.outcome is WritebackOutcome.COMMITTED]
    assert [a.bank for a in written] == [Bank.B, Bank.A, Bank.B, Bank.A]
    assert [a.block.seq for a in written if a.block] == [1, 2, 3, 4]


async def test_the_record_holds_what_was_there_before(
    bench: Callable[..., Bench], findings: Make
) -> None:
    b = bench()
    for stick_band in (5.0, 6.0, 7.0):
        await b.write(findings(stick_band))
    first, second, third = [a for a in b.said if a.outcome is WritebackOutcome.COMMITTED]
    assert third.bank_before == first.words
    assert third.active_before == second.words
    record = third.record("FC101", 12.5)
    assert (record.seq, record.bank, record.status) == (3, "B", "valid")
    assert record.utc_ms == 12_500


@pytest.mark.parametrize(
    ("verdict", "status"),
    [("no_stiction", Status.NO_STICTION), ("not_assessable", Status.NOT_ASSESSABLE)],
)
async def test_other_verdicts_have_their_status(
    bench: Callable[..., Bench], findings: Make, verdict: str, status: Status
) -> None:
    b = bench()
    b.submit(findings(verdict=verdict))
    await b.seconds(5)
    assert b.outcomes[-1] is WritebackOutcome.ACCEPTED
    assert b.said[-1].block is not None
    assert b.said[-1].block.status is status
    assert b.plc.state.model is None


async def test_the_heartbeat_counts_and_wraps(
    bench: Callable[..., Bench], device: Any, layout: ExchangeLayout
) -> None:
    device.words[layout.heartbeat] = 65534
    await bench().seconds(8)
    beats = [words[0] for _, address, words in device.writes if address == layout.heartbeat]
    assert beats == [65535, 0, 1, 2]


async def test_the_devices_word_order_is_used(
    bench: Callable[..., Bench], findings: Make, plc: Any
) -> None:
    plc.reader = BlockReader(101, word_order="little")
    b = bench(word_order="little")
    b.submit(findings(7.0))
    await b.seconds(5)
    assert plc.state.in_force.stick_band.value == 7.0


@pytest.mark.parametrize(
    ("readable", "requests"),
    [((), [(100, 5), (106, 2)]), (((0, 399),), [(100, 8)]), (((0, 105),), [(100, 5), (106, 2)])],
)
async def test_registers_between_are_read_along_only_where_the_site_allows(
    layout: ExchangeLayout, readable: tuple[tuple[int, int], ...], requests: list[tuple[int, int]]
) -> None:
    asked = []

    class Registers:
        async def read_registers(self, address: int, count: int) -> list[int]:
            asked.append((address, count))
            return [address + i for i in range(count)]

    least = replace(layout, ack_refusal=None, writer=None)
    exchange = Exchange(Registers(), least, "big", device="plc", max_gap=8, readable=readable)  # type: ignore[arg-type]
    words = await exchange.control()
    assert asked == requests
    assert (words.enable, words.ack_commit, words.heartbeat, words.commit) == (100, 104, 106, 107)


@pytest.mark.parametrize(
    ("code", "says"), [(3, "as 94 registers in one request"), (2, "addresses")]
)
async def test_a_bank_that_is_refused_gets_advice_that_can_be_followed(
    layout: ExchangeLayout, code: int, says: str
) -> None:
    """`check` refuses a max_registers below a block's length: it is no remedy here."""

    class Registers:
        async def read_registers(self, address: int, count: int) -> list[int]:
            raise ExceptionReplyError("plc", f"reading holding {address}, {count}", code)

    exchange = Exchange(Registers(), layout, "big", device="plc")  # type: ignore[arg-type]
    with pytest.raises(ExceptionReplyError) as caught:
        await exchange.bank(Bank.A)
    assert says in str(caught.value)
    assert "max_registers" not in str(caught.value)
    assert caught.value.number == code


@pytest.mark.parametrize("refused", [1, 2, 10])
async def test_the_optional_words_are_given_up_only_if_the_plc_really_lacks_them(
    layout: ExchangeLayout, refused: int
) -> None:
    asked = []

    class Registers:
        async def read_registers(self, address: int, count: int) -> list[int]:
            asked.append((address, count))
            # A PLC of an earlier layout, or one that ends its exceptions between two requests.
            if address + count > 108 and sum(a + n > 108 for a, n in asked) <= refused:
                raise ExceptionReplyError("plc", "reading", 2)
            return [address + i for i in range(count)]

    exchange = Exchange(Registers(), layout, "big", device="plc", readable=((0, 399),))  # type: ignore[arg-type]
    first = await exchange.control()
    second = await exchange.control()
    has_them = refused == 1
    for words in (first, second):
        assert (words.enable, words.commit) == (100, 107)
        assert (words.ack_refusal, words.writer) == ((105, 108) if has_them else (None, None))
