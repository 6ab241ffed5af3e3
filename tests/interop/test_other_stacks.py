"""Modbus stacks that are not ours, nor pymodbus, read the running PLC and its parameter block."""

from __future__ import annotations

import asyncio
import re
import shutil
import struct
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_asyncio

from benchmarks.libmodbus import LibModbus
from fieldlink.lab.plc import PlcServer, VirtualPlc
from fieldlink.registers import (
    BLOCK_FIELDS,
    BLOCK_REGISTERS,
    Bank,
    ExchangeLayout,
    ParameterBlock,
    Table,
    commit_word,
    encode_block,
)
from fieldlink.site import load_site
from loop_model import LoopModel, ProcessModel, ValveModel

HOST = "127.0.0.1"
AREA = ExchangeLayout.at(100)
STICK_BAND = next(field for field in BLOCK_FIELDS if field.name == "stick_band")
MODEL = LoopModel(ValveModel(1.79, 0.6), ProcessModel((-0.9,), (0.1,), 1, 0.0, 1.0))

SITE = """\
[site]
name = "interop"
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
register_map = "map.csv"
speed = 100.0
[loops.FC101]
device = "plc"
op = "FC101.OP"
pv = "FC101.PV"
scan = "FC101.SCAN"
period = 1.0
[loops.FC101.writeback]
base = 100
loop_id = 101
[loops.FC101.plant]
recording = "loop.csv"
"""
MAP = """\
tag,table,address,type,writable
FC101.OP,holding,0,float32,true
FC101.PV,input,2,float32,
FC101.SCAN,holding,4,uint16,
"""


@pytest_asyncio.fixture
async def server(tmp_path: Path) -> AsyncIterator[PlcServer]:
    """A running PLC that has accepted a block with S = 1.79 in bank B."""
    (tmp_path / "loop.csv").write_text("op,pv\n" + "47.25,12.5\n" * 60)
    (tmp_path / "map.csv").write_text(MAP)
    (tmp_path / "site.toml").write_text(SITE)
    stop = asyncio.Event()
    plc = VirtualPlc(load_site(tmp_path / "site.toml"), "plc", speed=100.0)
    block = ParameterBlock.from_model(
        MODEL, loop_id=101, seq=4, valid_for=3600, window_end_ms=1_795_000_000_000
    )
    plc.image.write(Table.HOLDING, AREA.bank_b, encode_block(block, "big"))
    plc.image.write(Table.HOLDING, AREA.commit, [commit_word(Bank.B, 4)])
    async with PlcServer({1: plc}, host=HOST) as server:
        running = asyncio.create_task(server.run(stop))
        yield server
        stop.set()
        await running


async def mbpoll(port: int, *arguments: str) -> list[str]:
    """Return the values that mbpoll prints, and fail with its words when it fails."""
    program = shutil.which("mbpoll")
    if program is None:
        pytest.skip("mbpoll is not installed (Debian package mbpoll)")
    process = await asyncio.create_subprocess_exec(
        *(program, "-m", "tcp", "-0", "-1", "-o", "5", "-p", str(port), HOST, *arguments),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    said = (await process.communicate())[0].decode()
    assert process.returncode == 0, said
    return re.findall(r"^\[\d+\]:\s+(\S+)", said, re.MULTILINE)


async def test_mbpoll_reads_signals_and_the_block_s_stick_band(server: PlcServer) -> None:
    assert await mbpoll(server.port, "-t", "4:float", "-B", "-r", "0") == ["47.25"]
    assert await mbpoll(server.port, "-t", "3:float", "-B", "-r", "2") == ["12.5"]
    address = str(AREA.bank_b + STICK_BAND.offset)
    assert await mbpoll(server.port, "-t", "4:float", "-B", "-r", address) == ["1.79"]


async def test_mbpoll_sees_the_acknowledgement(server: PlcServer) -> None:
    first = str(AREA.ack_seq)
    assert await mbpoll(server.port, "-t", "4", "-r", first, "-c", "3") == ["4", "1", "1"]


@pytest.mark.usefixtures("libmodbus")
async def test_libmodbus_decodes_the_block_s_stick_band(server: PlcServer) -> None:
    def read_block() -> tuple[list[int], float]:
        client = LibModbus(server.port)
        words = client.read(AREA.bank_b, BLOCK_REGISTERS)
        client.close()
        return words, client.real(words[STICK_BAND.offset : STICK_BAND.end])

    words, stick_band = await asyncio.to_thread(read_block)
    assert words[0] == 0x464C
    assert stick_band == struct.unpack("f", struct.pack("f", 1.79))[0]


@pytest.mark.usefixtures("libmodbus")
async def test_libmodbus_writes_a_block_that_the_plc_accepts(server: PlcServer) -> None:
    block = ParameterBlock.from_model(
        MODEL, loop_id=101, seq=5, valid_for=3600, window_end_ms=1_795_000_000_000
    )
    words = encode_block(block, "big")

    def write_block() -> list[int]:
        client = LibModbus(server.port)
        client.write(AREA.bank_a, words)
        assert client.read(AREA.bank_a, BLOCK_REGISTERS) == words
        client.write(AREA.commit, [commit_word(Bank.A, 5)])
        started = client.read(4, 1)[0]
        # Two cycles by the PLC's own counter: the one under way may have looked before the write.
        while client.read(4, 1)[0] < started + 2:
            pass
        acknowledged = client.read(AREA.ack_seq, 3)
        client.close()
        return acknowledged

    assert await asyncio.to_thread(write_block) == [5, 1, int(Bank.A)]


@pytest.mark.usefixtures("libmodbus")
async def test_libmodbus_names_the_refusals(server: PlcServer) -> None:
    def refused() -> list[str]:
        client = LibModbus(server.port)
        said = []
        for attempt in (
            lambda: client.read(2000, 1),
            lambda: client.write(AREA.ack_seq, [9]),
            lambda: client.write(0, [0x7FC0, 0]),  # NaN into a writable tag
        ):
            with pytest.raises(OSError, match="Illegal") as error:
                attempt()
            said.append(str(error.value))
        client.close()
        return said

    assert await asyncio.to_thread(refused) == [
        "Illegal data address",
        "Illegal data address",
        "Illegal data value",
    ]
