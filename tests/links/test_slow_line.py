"""A serial line at its baud rate: while bytes are on it, the device is not silent."""

from __future__ import annotations

import asyncio
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fieldlink.links import SystemClock
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.registers import DataType, Table, Tag, plan_reads
from fieldlink.site import Device
from tests.wire_bytes import crc

BAUD, REGISTERS = 2400, 61
ON_LINE = 11 / BAUD * (8 + 5 + 2 * REGISTERS)
"""Seconds that request and reply take: 0.62."""


@contextmanager
def paced_device(port: str) -> Iterator[None]:
    """Answer each request when its bytes and those of the reply would have passed."""
    loop, line = asyncio.get_running_loop(), os.open(port, os.O_RDWR | os.O_NOCTTY)

    def answer() -> None:
        unit, function, address, count = struct.unpack(">BBHH", os.read(line, 512)[:6])
        words = range(address, address + count)
        reply = struct.pack(f">BBB{count}H", unit, function, 2 * count, *words)
        loop.call_later(ON_LINE, os.write, line, reply + crc(reply))

    loop.add_reader(line, answer)
    try:
        yield
    finally:
        loop.remove_reader(line)
        os.close(line)


async def test_a_long_reply_on_a_slow_line_is_waited_for(serial_line: tuple[str, str]) -> None:
    """With a time-out from the request's first byte no such reply would ever come in time."""
    plant, here = serial_line
    device = Device(
        link="modbus-rtu",
        serial_port=here,
        baud=BAUD,
        parity="none",
        unit=1,
        timeout=0.4,
        register_map=Path("map.csv"),
    )
    tags = [Tag(f"R{n}", Table.HOLDING, n, DataType.UINT16) for n in range(REGISTERS)]
    link = ModbusLink(ModbusSettings("plc", device), plan_reads(tags), SystemClock())
    with paced_device(plant):
        try:
            scan = await link.scan()
        finally:
            await link.close()
    assert scan.failures == ()
    assert [scan[tag.name].value for tag in tags] == list(range(REGISTERS))
