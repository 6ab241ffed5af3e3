"""Requests a second of the Modbus link, beside a bare pymodbus loop and libmodbus in the same run.

    python -m benchmarks.link [--seconds 6] [--out FOLDER]

Each client has a server of its own (libmodbus in a process of its own, so that it is nobody's
bottleneck) and one request in flight. The columns are:

- *read*: a block of holding registers, as words. The bare loop is `read_holding_registers` of
  pymodbus' asynchronous client; libmodbus is called through ctypes.
- *scan*: the same block as float tags with range, quality and time stamps, in the link by its read
  plan, in the bare loop with pymodbus' `convert_from_registers` per tag.

They take turns in slices of a twentieth of a second and the median slice counts, so that a busy
machine slows all of them alike. What counts are the ratios.
"""

from __future__ import annotations

import argparse
import asyncio
import statistics
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

from pymodbus.client import AsyncModbusTcpClient

from benchmarks.libmodbus import HOST, LibModbus
from benchmarks.report import keep, machine, table
from fieldlink.links import SystemClock
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.registers import DataType, Table, Tag, plan_reads
from fieldlink.site import Device

SLICE = 0.05
SIZES = (10, 60, 120)

Step = Callable[[], Awaitable[object]]


async def measure(steps: dict[str, Step], seconds: float) -> dict[str, float]:
    """Return calls a second of each step: the median of slices in which the steps take turns."""
    rates: dict[str, list[float]] = {name: [] for name in steps}
    for step in steps.values():
        await step()
    until = time.perf_counter() + seconds
    while time.perf_counter() < until:
        for name, step in steps.items():
            calls, began = 0, time.perf_counter()
            while (spent := time.perf_counter() - began) < SLICE:
                await step()
                calls += 1
            rates[name].append(calls / spent)
    return {name: statistics.median(found) for name, found in rates.items()}


async def compare(ports: list[int], registers: int, seconds: float) -> dict[str, float]:
    """Return the figures of one block size; libmodbus serves one client a process."""
    ours, theirs, third = ports
    device = Device(link="modbus-tcp", host=HOST, port=ours, register_map=Path("none"))
    tags = [
        Tag(f"T{i}", Table.HOLDING, 2 * i, DataType.FLOAT32, low=-1e30, high=1e30)
        for i in range(registers // 2)
    ]
    link = ModbusLink(ModbusSettings("plc", device), plan_reads(tags), SystemClock())
    bare = AsyncModbusTcpClient(HOST, port=theirs, timeout=1.0, retries=0)
    await bare.connect()
    other = await asyncio.to_thread(LibModbus, third)

    async def bare_scan() -> None:
        reply = await bare.read_holding_registers(0, count=registers)
        for i in range(0, registers, 2):
            bare.convert_from_registers(reply.registers[i : i + 2], bare.DATATYPE.FLOAT32)

    async def with_libmodbus() -> None:
        other.read(0, registers)

    try:
        return await measure(
            {
                "read": lambda: link.read_registers(0, registers),
                "bare read": lambda: bare.read_holding_registers(0, count=registers),
                "libmodbus": with_libmodbus,
                "scan": link.scan,
                "bare scan": bare_scan,
            },
            seconds,
        )
    finally:
        await link.close()
        bare.close()
        other.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=6.0, help="per block size")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    servers = [
        subprocess.Popen(
            [sys.executable, "-m", "benchmarks.libmodbus", "tcp"], stdout=subprocess.PIPE, text=True
        )
        for _ in range(3)
    ]
    figures = {}
    try:
        ports = [int(server.stdout.readline()) for server in servers if server.stdout is not None]
        for registers in SIZES:
            figures[registers] = asyncio.run(compare(ports, registers, arguments.seconds))
    finally:
        for server in servers:
            server.kill()
            server.wait()
    rows = [
        [
            registers,
            found["read"] / found["bare read"],
            found["scan"] / found["bare scan"],
            found["scan"] / found["bare read"],
            found["read"] / found["libmodbus"],
            found["bare read"] / found["libmodbus"],
        ]
        for registers, found in figures.items()
    ]
    text = table(
        [
            "registers a request",
            "our read / bare pymodbus read",
            "our scan / bare pymodbus with conversion",
            "our scan / bare pymodbus read",
            "our read / libmodbus",
            "bare pymodbus read / libmodbus",
        ],
        rows,
    )
    print(text)
    keep(
        arguments.out,
        "link",
        "# Requests a second of the Modbus link, as ratios measured in one run\n\n" + text,
        {"machine": machine(), "per_second": figures},
    )


if __name__ == "__main__":
    main()
