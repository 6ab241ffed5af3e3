"""The write-back over a real socket, against a PLC that follows the reader's rules."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from fieldlink.daemon.estimating import Findings
from fieldlink.daemon.exchange import Exchange
from fieldlink.daemon.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback import WriteBack
from fieldlink.links import LinkError, SystemClock
from fieldlink.links.backoff import BackoffSettings
from fieldlink.links.modbus import WRITTEN_PARTS, ModbusLink, ModbusSettings
from fieldlink.registers import (
    BLOCK_REGISTERS,
    Bank,
    BlockLimits,
    BlockReader,
    ExchangeLayout,
    Order,
    Status,
)
from fieldlink.site import Device, WriteLimits
from fieldlink.site import WriteBack as Settings

Make = Callable[..., Findings]
WINDOW_END = 1_795_262_400.0


@dataclass
class Bench:
    """A write-back, its PLC, and the plant's time in the tester's hands."""

    writeback: WriteBack
    plc: Any
    said: list[Attempt]
    now: float = 0.0
    errors: list[LinkError] = field(default_factory=list)

    @property
    def outcomes(self) -> list[WritebackOutcome]:
        return [attempt.outcome for attempt in self.said]

    def submit(self, findings: Findings) -> None:
        self.writeback.submit(findings, WINDOW_END)

    async def seconds(self, seconds: float, scanning: bool = True) -> None:
        """Let plant time pass: every second the write-back is called and the PLC scans."""
        for _ in range(round(seconds)):
            try:
                await self.writeback.service(self.now)
            except LinkError as error:
                self.errors.append(error)
            if scanning:
                self.plc.scan()
            self.now += 1.0

    async def write(self, findings: Findings) -> None:
        """Have findings written and acknowledged, with time enough for the minimum interval."""
        self.submit(findings)
        await self.seconds(5)
        assert self.outcomes[-2:] == [WritebackOutcome.COMMITTED, WritebackOutcome.ACCEPTED]
        await self.seconds(70)


@pytest.fixture
async def bench(
    device: Any, plc: Any, layout: ExchangeLayout
) -> AsyncIterator[Callable[..., Bench]]:
    links = []

    def make(
        *,
        read_only: bool = False,
        pause: Callable[[], Awaitable[None]] | None = None,
        word_order: Order = "big",
        **settings: Any,
    ) -> Bench:
        link = ModbusLink(
            ModbusSettings(
                "plc",
                Device(
                    link="modbus-tcp",
                    host="127.0.0.1",
                    port=device.port,
                    timeout=0.15,
                    register_map=Path("map.csv"),
                ),
                backoff=BackoffSettings(first=1e-6, cap=1e-6),
                writable=tuple((a, b) for part, a, b in layout.spans() if part in WRITTEN_PARTS),
            ),
            (),
            SystemClock(),
        )
        links.append(link)
        said: list[Attempt] = []

        async def nothing() -> None:
            plc.scan()

        writeback = WriteBack(
            Settings(enabled=True, loop_id=101, base=100, **({"min_windows": 1} | settings)),
            Exchange(link, layout, word_order),
            period=1.0,
            read_only=read_only,
            pause=pause or nothing,
            report=said.append,
        )
        return Bench(writeback, plc, said)

    yield make
    for link in links:
        await link.close()


def bank_of(device: Any, layout: ExchangeLayout, bank: Bank) -> list[int]:
    start = layout.bank_address(bank)
    return list(device.words[start : start + BLOCK_REGISTERS])


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
    assert [(function, address) for function, address, _ in device.requests[-3:]] == [
        (16, layout.bank_b),
        (3, layout.bank_b),
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


@pytest.mark.parametrize(("acknowledged", "following"), [(7, 8), (65535, 1)])
async def test_after_a_restart_the_sequence_goes_on_from_the_acknowledged_one(
    bench: Callable[..., Bench], findings: Make, plc: Any, acknowledged: int, following: int
) -> None:
    before = bench()
    before.writeback._last_seq = acknowledged - 1
    await before.write(findings(5.0))
    assert plc.state.ack_seq == acknowledged
    after = bench()
    await after.write(findings(6.0))
    assert plc.state.ack_seq == following


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


async def test_a_change_within_the_deadband_is_not_written(
    bench: Callable[..., Bench], findings: Make
) -> None:
    b = bench(deadband=0.1)
    await b.write(findings(7.0, 4.0))
    b.submit(findings(7.09, 3.91))
    await b.seconds(5)
    assert b.outcomes[-1] is WritebackOutcome.UNCHANGED
    await b.write(findings(7.0, 4.2))


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
    for stick_band in (6.0, 7.0, 8.0):
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
    assert b.plc.state.in_force.stick_band.value == 8.0
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
    assert named in b.said[0].reason
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


async def test_the_heartbeat_counts_and_wraps(
    bench: Callable[..., Bench], device: Any, layout: ExchangeLayout
) -> None:
    device.words[layout.heartbeat] = 65534
    await bench().seconds(8)
    beats = [words[0] for _, address, words in device.writes if address == layout.heartbeat]
    assert beats == [65535, 0, 1, 2]


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

    exchange = Exchange(Registers(), layout, "big", max_gap=8, readable=readable)  # type: ignore[arg-type]
    words = await exchange.control()
    assert asked == requests
    assert (words.enable, words.ack_commit, words.heartbeat, words.commit) == (100, 104, 106, 107)
