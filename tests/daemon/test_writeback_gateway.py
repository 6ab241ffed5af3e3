"""What a gateway says for a PLC that it has lost decides nothing, and a moment of it passes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.writeback.exchange_io import NoAreaError
from fieldlink.daemon.writeback.outcomes import WritebackOutcome
from fieldlink.registers import ExchangeLayout
from tests.daemon.bench import Bench

Benches = Callable[..., Bench]
Make = Callable[..., Findings]


@pytest.mark.parametrize("allowed", [True, False], ids=["enabled", "not enabled"])
async def test_one_number_everywhere_is_no_exchange_area(
    bench: Benches, findings: Make, device: Any, allowed: bool
) -> None:
    b = bench(identity=11)
    await b.write(findings(7.0))
    b.writeback.withdraw("the valve is being repaired", 0.0)
    await b.seconds(6)
    b.plc.words[100] = int(allowed)
    await b.seconds(4)
    own, writes = list(b.plc.words), len(device.writes)
    b.plc.words[:] = [0xFFFF] * len(own)
    await b.seconds(20, scanning=False)
    assert {type(error) for error in b.errors} == {NoAreaError}
    assert str(b.errors[0]) == (
        "device plc: all words of the exchange area read 65535, which no PLC program gives; "
        "nothing is written meanwhile; check whether a gateway has lost its PLC"
    )
    # Its enable bit is set and its writer is another one, and neither is believed.
    assert len(device.writes) == writes
    b.plc.words[:] = own
    b.submit(findings(7.0))
    await b.seconds(6)
    assert b.outcomes[-1] is WritebackOutcome.HELD
    assert b.told == []


async def test_registers_of_something_else_are_not_written_to(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench(identity=11)
    own = list(b.plc.words)
    # as with a base that is wrong: every register holds a number of its own, and bit 0 is set
    b.plc.words[:] = [n + 1 for n in range(len(own))]
    b.submit(findings(7.0))
    await b.seconds(30, scanning=False)
    assert device.writes == []
    ((kind, message),) = b.told
    assert kind == "writeback.disagrees"
    assert "active_bank is 104, which is not a bank; nothing is written there" in message
    b.plc.words[:] = own
    await b.seconds(6)
    assert b.outcomes[-1] is WritebackOutcome.ACCEPTED
    assert layout.heartbeat in {address for _, address, _ in device.writes}


async def test_a_writer_that_is_gone_again_was_none(
    bench: Benches, findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench(identity=11, min_interval=0.0)
    await b.write(findings(7.0))
    assert layout.writer is not None
    written = len(device.writes)
    b.submit(findings(9.0))
    device.words[layout.writer] = 0xFFFF
    await b.seconds(6)
    device.words[layout.writer] = 11
    # Only heartbeats meanwhile: no block, no commit, and its identity is not written over another.
    assert {address for _, address, _ in device.writes[written:]} <= {layout.heartbeat}
    assert b.outcomes[-1] is WritebackOutcome.CONTESTED
    await b.seconds(6)
    ((kind, said),) = b.told
    assert kind == "writeback.uncontested"
    assert said.startswith("writer 65535 was read, as if another installation wrote, and is gone")
    assert b.plc.state.in_force.stick_band.value == 9.0


async def test_zeros_of_a_plc_that_starts_again_end_no_order(
    bench: Benches, findings: Make, layout: ExchangeLayout
) -> None:
    b = bench(min_interval=0.0)
    await b.write(findings(7.0))
    b.writeback.withdraw("the valve is being repaired", 0.0)
    await b.seconds(6)
    b.plc.words[100:320] = [0] * 220
    await b.seconds(6, scanning=False)
    b.plc.words[layout.enable] = 1
    b.submit(findings(7.0))
    await b.seconds(6)
    assert b.outcomes[-1] is WritebackOutcome.HELD
    # An operator who clears the bit and sets it again has decided.
    b.plc.words[layout.enable] = 0
    await b.seconds(4)
    b.plc.words[layout.enable] = 1
    await b.seconds(4)
    b.submit(findings(7.0))
    await b.seconds(6)
    assert b.outcomes[-1] is WritebackOutcome.ACCEPTED
