"""PLCs that do not keep what is written, lose it, or answer late: named, and nothing half done."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.writeback.outcomes import WritebackOutcome
from fieldlink.registers import BlockReader, ExchangeLayout
from tests.daemon.bench import Bench

Make = Callable[..., Findings]
Benches = Callable[..., Bench]


@pytest.mark.parametrize(
    ("keeps", "said"),
    [
        (lambda _: 0, "the device confirms the write and drops it"),
        (lambda word: min(word, 32767), "no register keeps more than 32767"),
        (lambda word: word >> 8 | (word & 0xFF) << 8, "the two bytes of each register"),
    ],
)
async def test_what_a_device_makes_of_a_write_is_named(
    bench: Benches,
    findings: Make,
    device: Any,
    layout: ExchangeLayout,
    keeps: Callable[[int], int],
    said: str,
) -> None:
    def change() -> None:
        function, address, words = device.writes[-1]
        if function == 16:
            device.words[address : address + len(words)] = [keeps(word) for word in words]

    device.after_write = change
    b = bench()
    b.submit(findings())
    await b.seconds(3)
    assert b.outcomes[0] is WritebackOutcome.READBACK_DIFFERS
    assert said in b.said[0].reason
    assert "instead of 0x" in b.said[0].reason
    assert device.words[layout.commit] == 0


async def test_a_device_that_never_keeps_a_block_is_asked_ever_less_often(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    device.after_write = lambda: device.words.__setitem__(layout.bank_b, 0)
    b = bench(min_interval=60.0)
    b.submit(findings())
    await b.seconds(1200)
    assert 4 <= b.outcomes.count(WritebackOutcome.READBACK_DIFFERS) <= 7


@pytest.mark.parametrize("is_spoilt_again", [False, True])
async def test_a_block_that_another_client_spoils_after_the_commit_is_written_once_more(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout, is_spoilt_again: bool
) -> None:
    def spoil() -> None:
        function, address, words = device.writes[-1]
        if function == 6 and address == layout.commit:
            bank = layout.bank_b if words[0] >> 8 else layout.bank_a
            device.words[bank + 40 : bank + 50] = [777] * 10
            device.after_write = spoil if is_spoilt_again else None

    device.after_write = spoil
    b = bench(min_interval=10.0)
    b.submit(findings(7.0))
    await b.seconds(60)
    rejected = [attempt for attempt in b.said if attempt.outcome is WritebackOutcome.REJECTED]
    assert "the CRC does not match" in rejected[0].reason
    assert "another client or the PLC's program wrote to the bank: 10 registers" in (
        rejected[0].reason
    )
    assert b.outcomes.count(WritebackOutcome.COMMITTED) == 2
    if is_spoilt_again:
        assert len(rejected) == 2
        assert b.writeback.waiting is None
    else:
        assert b.plc.state.in_force.stick_band.value == 7.0


async def test_a_reader_that_finds_a_whole_block_torn_is_to_blame_itself(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench(min_interval=10.0)
    b.submit(findings(7.0))
    await b.seconds(1, scanning=False)
    device.words[layout.ack_result], device.words[layout.ack_commit] = 5, 0x0101
    await b.seconds(30, scanning=False)
    assert b.outcomes == [WritebackOutcome.COMMITTED, WritebackOutcome.REJECTED]
    assert "the bank holds what was written: compare the PLC's block reader" in b.said[-1].reason


async def test_a_late_acknowledgement_completes_the_record(bench: Benches, findings: Make) -> None:
    b = bench()
    b.submit(findings(7.0))
    await b.seconds(40, scanning=False)
    assert b.outcomes[-1] is WritebackOutcome.NOT_ACKNOWLEDGED
    await b.seconds(5)
    assert b.outcomes[-1] is WritebackOutcome.ACCEPTED
    assert "answered 40 s after the commit" in b.said[-1].reason
    said = len(b.said)
    await b.seconds(20)
    assert len(b.said) == said


@pytest.mark.parametrize("is_enabled", [0, 1])
async def test_a_plc_that_loses_its_registers_loses_its_block_with_an_event(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout, is_enabled: int
) -> None:
    b = bench(min_interval=10.0)
    await b.write(findings(7.0))
    device.words[:] = [0] * len(device.words)
    device.words[layout.enable] = is_enabled
    b.plc.reader = BlockReader(101)
    await b.seconds(40)
    # Not "the heartbeat register does not keep what is written": nothing is written meanwhile.
    ((kind, message),) = b.told
    assert kind == "writeback.lost"
    assert "block 1 was in force" in message
    assert "RETAIN" in message
    assert b.writeback.compensates is False
    device.words[layout.enable] = 1
    b.submit(findings(7.0))
    await b.seconds(20)
    assert b.outcomes[-1] is WritebackOutcome.ACCEPTED
    assert b.plc.state.in_force.stick_band.value == 7.0
