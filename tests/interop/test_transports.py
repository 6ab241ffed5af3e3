"""Our link against two other stacks' servers, our PLC against three other stacks' clients.

libmodbus is C, modbus-serial JavaScript, mbpoll a program over its own libmodbus; each over TCP and
over RTU framing on a serial line.
"""

from __future__ import annotations

import asyncio
import json
import re
import shutil
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from benchmarks.libmodbus import LibModbus
from fieldlink.lab.plc import Listening
from fieldlink.lab.plc.image import RegisterImage
from fieldlink.lab.plc.listening import listen
from fieldlink.lab.plc.modbus_device import modbus_device
from fieldlink.links import LinkState, SystemClock
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.registers import DataType, Table, Tag, plan_reads
from fieldlink.site import Device

HOST = "127.0.0.1"
CLIENT = str(Path(__file__).resolve().parent / "node" / "client.js")
SERVER = str(Path(__file__).resolve().parent / "node" / "server.js")
Start = Callable[..., Any]
Line = tuple[str, str]

WORDS = [Tag(f"H{n}", Table.HOLDING, n, DataType.UINT16) for n in (0, 7, 124, 130)]
OTHERS = [
    Tag("I3", Table.INPUT, 3, DataType.UINT16),
    Tag("C9", Table.COIL, 9, DataType.BOOL),
    Tag("D10", Table.DISCRETE, 10, DataType.BOOL),
    Tag("L", Table.HOLDING, 20, DataType.UINT32),
]


def network(port: str) -> Device:
    return Device(
        link="modbus-tcp", host=HOST, port=int(port), timeout=5.0, register_map=Path("none")
    )


def serial(port: str) -> Device:
    return Device(
        link="modbus-rtu", serial_port=port, parity="none", timeout=5.0, register_map=Path("none")
    )


async def assert_our_link_serves(device: Device) -> None:
    plan = plan_reads([*WORDS, *OTHERS])
    link = ModbusLink(ModbusSettings("other", device, writable=((30, 40),)), plan, SystemClock())
    try:
        scan = await link.scan()
        assert [str(failure) for failure in scan.failures] == []
        assert {name: reading.value for name, reading in scan.readings.items()} == {
            "H0": 0.0,
            "H7": 7.0,
            "H124": 124.0,
            "H130": 130.0,
            "I3": 1003.0,
            "C9": 1.0,
            "D10": 0.0,
            "L": 20.0 * 65536.0 + 21.0,
        }
        assert link.state is LinkState.GOOD
        await link.write_registers(30, [5, 6, 7])
        await link.write_register(33, 8)
        assert await link.read_registers(30, 4) == [5, 6, 7, 8]
    finally:
        await link.close()


async def assert_holes_are_found(device: Device, hole: int) -> None:
    tags = [Tag(f"H{n}", Table.HOLDING, n, DataType.UINT16) for n in range(hole - 4, hole + 2)]
    link = ModbusLink(ModbusSettings("other", device), plan_reads(tags), SystemClock())
    try:
        scan = await link.scan()
        assert [n for n in scan.readings if scan[n].good] == [
            f"H{n}" for n in range(hole - 4, hole)
        ]
        assert set(link.quarantined) == {f"H{hole}", f"H{hole + 1}"}
    finally:
        await link.close()


async def test_our_link_and_a_libmodbus_server(libmodbus: tuple[str, ...], start: Start) -> None:
    async with start(*libmodbus, "tcp") as port:
        await assert_our_link_serves(network(port))
        await assert_holes_are_found(network(port), 1000)


async def test_our_link_and_a_libmodbus_server_on_a_serial_line(
    libmodbus: tuple[str, ...], serial_line: Line, start: Start
) -> None:
    there, here = serial_line
    async with start(*libmodbus, "rtu", there):
        await assert_our_link_serves(serial(here))


async def test_our_link_and_a_javascript_server(node: tuple[str, ...], start: Start) -> None:
    async with start(*node, SERVER, "tcp") as port:
        await assert_our_link_serves(network(port))
        await assert_holes_are_found(network(port), 500)


async def test_our_link_and_a_javascript_server_on_a_serial_line(
    node: tuple[str, ...], serial_line: Line, start: Start
) -> None:
    there, here = serial_line
    async with start(*node, SERVER, "rtu", there, "1"):
        await assert_our_link_serves(serial(here))


@asynccontextmanager
async def our_plc(place: Listening) -> AsyncIterator[int]:
    image = RegisterImage()
    image.define(Table.HOLDING, 10, 2, writable=True)
    image.put(Table.HOLDING, 10, [0x41C8, 0])
    image.define(Table.INPUT, 5, 1)
    image.put(Table.INPUT, 5, [55])
    image.define(Table.COIL, 19, 1, writable=True)
    server, port = await listen([modbus_device(image, 1)], place)
    try:
        yield port
    finally:
        await server.shutdown()  # type: ignore[no-untyped-call]
        await asyncio.sleep(0)


async def said_by(*command: str) -> str:
    process = await asyncio.create_subprocess_exec(
        *command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    said = (await process.communicate())[0].decode()
    assert process.returncode == 0, said
    return said


async def assert_javascript_is_served(*command: str) -> None:
    assert json.loads(await said_by(*command)) == {
        "before": [0x41C8, 0],
        "input": [55],
        "coil": False,
        "after": [0x4248, 9],
        "refused": 2,
    }


@pytest.mark.parametrize("kind", ["tcp", "rtu-tcp"])
async def test_a_javascript_client_and_our_plc(node: tuple[str, ...], kind: str) -> None:
    async with our_plc(Listening(link=f"modbus-{kind}")) as port:
        await assert_javascript_is_served(*node, CLIENT, kind, str(port))


async def test_a_javascript_client_and_our_plc_on_a_serial_line(
    node: tuple[str, ...], serial_line: Line
) -> None:
    there, here = serial_line
    async with our_plc(Listening(link="modbus-rtu", serial_port=there)):
        await assert_javascript_is_served(*node, CLIENT, "rtu", here)


def talk(port: int | str) -> tuple[list[int], list[int], list[int], str]:
    client = LibModbus(port)
    try:
        before, inputs = client.read(10, 2), client.read_inputs(5, 1)
        client.write(10, [1, 2])
        with pytest.raises(OSError, match="Illegal") as refused:
            client.read(400, 1)
        return before, inputs, client.read(10, 2), str(refused.value)
    finally:
        client.close()


@pytest.mark.usefixtures("libmodbus")
async def test_a_libmodbus_client_and_our_plc_on_a_serial_line(serial_line: Line) -> None:
    there, here = serial_line
    async with our_plc(Listening(link="modbus-rtu", serial_port=there)):
        said = await asyncio.to_thread(talk, here)
    assert said == ([0x41C8, 0], [55], [1, 2], "Illegal data address")


@pytest.mark.usefixtures("libmodbus")
async def test_a_libmodbus_client_and_our_plc() -> None:
    async with our_plc(Listening()) as port:
        said = await asyncio.to_thread(talk, port)
    assert said == ([0x41C8, 0], [55], [1, 2], "Illegal data address")


async def test_mbpoll_and_our_plc_on_a_serial_line(serial_line: Line) -> None:
    program = shutil.which("mbpoll")
    if program is None:
        pytest.skip("mbpoll is not installed (Debian package mbpoll)")
    there, here = serial_line
    options = ("-m", "rtu", "-b", "19200", "-P", "none", "-0", "-1", "-o", "5", "-a", "1")
    async with our_plc(Listening(link="modbus-rtu", serial_port=there)):
        said = await said_by(program, *options, "-t", "4:float", "-B", "-r", "10", here)
        assert re.findall(r"^\[10\]:\s+(\S+)", said, re.MULTILINE) == ["25"]
        await said_by(program, *options, "-t", "4", "-r", "10", here, "7", "8")
        said = await said_by(program, *options, "-t", "4", "-r", "10", "-c", "2", here)
        assert re.findall(r"^\[\d+\]:\s+(\S+)", said, re.MULTILINE) == ["7", "8"]
