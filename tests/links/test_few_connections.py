"""A gateway that takes one connection, with several units behind it."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from fieldlink.links import LinkTimeoutError, SystemClock
from fieldlink.links.backoff import BackoffSettings
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.registers import DataType, Table, Tag, plan_reads
from fieldlink.site import Device, Quirks
from tests.links.patience import PATIENCE, expecting_silence
from tests.loopback import LoopbackServer

SLOW = 9


@dataclass(kw_only=True)
class Gateway(LoopbackServer):
    """Every register of a unit holds its number; one unit answers when another one is asked."""

    open: int = 0
    connections: int = 0
    late: list[bytes] = field(default_factory=list)

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self.open:
            return
        self.open += 1
        self.connections += 1
        try:
            while True:
                head = await reader.readexactly(7)
                transaction, _, length, unit = struct.unpack(">HHHB", head)
                _, _, count = struct.unpack(">BHH", await reader.readexactly(length - 1))
                body = struct.pack(f">BB{count}H", 3, 2 * count, *[unit] * count)
                frame = struct.pack(">HHHB", transaction, 0, len(body) + 1, unit) + body
                self.late.append(frame)
                if unit != SLOW:
                    writer.write(b"".join(self.late))
                    self.late.clear()
        finally:
            self.open -= 1


@pytest.fixture
async def gateway() -> AsyncIterator[Gateway]:
    running = Gateway()
    await running.start()
    yield running
    await running.stop()


def unit_of(gateway: Gateway, unit: int, *, takes_turns: bool) -> ModbusLink:
    device = Device(
        link="modbus-tcp",
        host="127.0.0.1",
        port=gateway.port,
        unit=unit,
        timeout=PATIENCE,
        register_map=Path("map.csv"),
        quirks=Quirks(close_after_scan=takes_turns),
    )
    tags = [Tag(f"T{i}", Table.HOLDING, i * 300, DataType.UINT16) for i in range(2)]
    backoff = BackoffSettings(first=1e-6, cap=1e-6)
    settings = ModbusSettings(f"u{unit}", device, backoff=backoff)
    return ModbusLink(settings, plan_reads(tags), SystemClock())


async def test_units_at_one_address_take_turns_on_one_connection(gateway: Gateway) -> None:
    links = [unit_of(gateway, unit, takes_turns=True) for unit in (1, 2, 3)]
    scans = await asyncio.gather(*(link.scan() for link in links))
    for unit, scan in enumerate(scans, start=1):
        assert [scan[tag].value for tag in ("T0", "T1")] == [unit, unit]
    assert gateway.connections == 1
    for link in links:
        await link.close()


async def test_a_unit_that_answers_late_costs_its_neighbours_no_connection(
    gateway: Gateway,
) -> None:
    slow, good = (unit_of(gateway, unit, takes_turns=True) for unit in (SLOW, 1))
    with expecting_silence(slow):
        # The neighbour waits meanwhile, and gets the late answer before its own.
        late, scan = await asyncio.gather(slow.scan(), good.scan())
    assert isinstance(late.failures[0], LinkTimeoutError)
    assert not scan.failures
    assert scan["T0"].value == 1.0
    assert gateway.connections == 1
    await slow.close()
    await good.close()


async def test_who_finds_the_connection_taken_is_told_how_to_share_it(gateway: Gateway) -> None:
    first, second = (unit_of(gateway, unit, takes_turns=False) for unit in (1, 2))
    assert not (await first.scan()).failures
    said = str((await second.scan()).failures[0])
    assert "another connection to it stands" in said
    assert "set close_after_scan in the quirks of all devices at this address" in said
    await first.close()
    await second.close()
