"""A PLC whose registers prove themselves: every value tells which signal and cycle it is of.

Three loops lie so far apart that each is a request of its own, all of the same length: what is
taken for another register's value, or for another cycle's, does not fit and is found.
"""

from __future__ import annotations

import asyncio
import struct
import time
from dataclasses import dataclass, field

from tests.loopback import LoopbackServer
from tests.wire_bytes import crc

LOOPS = ("L0", "L1", "L2")
STRIDE = 100
CYCLE = 0.05
"""Wall seconds of a cycle."""


def op_of(loop: int, cycle: int) -> float:
    return 1000.0 * loop + cycle % 997


def pv_of(loop: int, cycle: int) -> float:
    return -1000.0 * loop - 500.0 - cycle % 991


@dataclass
class SelfCheckingPlc(LoopbackServer):
    """Serves FC3 (and the echo of FC8) over TCP with the framing ``tcp`` or ``rtu``."""

    framing: str
    requests: int = 0
    _begin: float = field(default_factory=time.monotonic)

    @property
    def cycle(self) -> int:
        return 1 + int((time.monotonic() - self._begin) / CYCLE)

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while True:
            head, unit, body = await read_request(reader, self.framing)
            self.requests += 1
            writer.write(frame(self.framing, head, unit, self._answer(body)))
            await writer.drain()

    def _answer(self, body: bytes) -> bytes:
        function, address, count = struct.unpack(">BHH", body[:5])
        if function == 8:
            return body
        cycle = self.cycle
        words = [self._word(address + k, cycle) for k in range(count)]
        return struct.pack(f">BB{count}H", function, 2 * count, *words)

    def _word(self, address: int, cycle: int) -> int:
        loop, offset = divmod(address, STRIDE)
        packed = struct.pack(
            ">ffH", op_of(loop, cycle), pv_of(loop, cycle), cycle & 0xFFFF
        ) + bytes(2 * STRIDE)
        return int.from_bytes(packed[2 * offset : 2 * offset + 2], "big")


async def read_request(reader: asyncio.StreamReader, framing: str) -> tuple[int, int, bytes]:
    """Return transaction id (0 on RTU), unit and PDU of a request that is eight bytes on RTU."""
    if framing == "rtu":
        data = await reader.readexactly(8)
        return 0, data[0], data[1:6]
    head = await reader.readexactly(7)
    transaction, _, length, unit = struct.unpack(">HHHB", head)
    return transaction, unit, await reader.readexactly(length - 1)


def frame(framing: str, transaction: int, unit: int, pdu: bytes) -> bytes:
    """Return a whole frame."""
    if framing == "rtu":
        data = bytes([unit]) + pdu
        return data + crc(data)
    return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit) + pdu


def site_text(ports: dict[str, tuple[int | str, str]], timeouts: dict[str, float]) -> str:
    """A site with the three loops of each device; name to (TCP or serial port, framing)."""
    parts = ['[site]\nname = "faults"\n[web]\nenabled = false\n']
    for name, (port, framing) in ports.items():
        link = "modbus-rtu-tcp" if framing == "rtu" else "modbus-tcp"
        where = f'link = "{link}"\nhost = "127.0.0.1"\nport = {port}'
        if isinstance(port, str):
            where = f'link = "modbus-rtu"\nserial_port = "{port}"\nbaud = 115200\nparity = "none"'
        parts.append(
            f"[devices.{name}]\n{where}\n"
            f'register_map = "map.csv"\ntimeout = {timeouts[name]}\nspeed = {1.0 / CYCLE}\n'
            f"retry_after_max = 0.2\n"
        )
        for loop in LOOPS:
            parts.append(
                f'[loops."{name}.{loop}"]\ndevice = "{name}"\nop = "{loop}.OP"\npv = "{loop}.PV"\n'
                f'scan = "{loop}.SCAN"\nperiod = 1.0\nwindow = 100000\n'
            )
    return "\n".join(parts)


def map_text() -> str:
    """The register map of the three loops."""
    rows = ["tag,table,address,type"]
    for number, loop in enumerate(LOOPS):
        base = STRIDE * number
        rows += [
            f"{loop}.OP,holding,{base},float32",
            f"{loop}.PV,holding,{base + 2},float32",
            f"{loop}.SCAN,holding,{base + 4},uint16",
        ]
    return "\n".join(rows) + "\n"
