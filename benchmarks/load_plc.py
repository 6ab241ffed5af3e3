"""A PLC process for `benchmarks.load`: many sticky loops behind one or many Modbus TCP ports.

It answers FC3 from a register image that is one second old at most, with as little work a request
as asyncio allows, so that what is measured is the daemon.

    python -m benchmarks.load_plc PORTS LOOPS_A_PORT    # prints the ports, then serves
"""

from __future__ import annotations

import asyncio
import struct
import sys

import numpy as np

__all__ = ["REGISTERS_A_LOOP"]

REGISTERS_A_LOOP = 4
"""OP and PV as float32."""


class Loops:
    """Loops with sticky valves in a slow limit cycle; the image is what FC3 reads."""

    def __init__(self, count: int, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._phase = self._rng.uniform(0.0, 1.0, count)
        self._length = self._rng.uniform(20.0, 60.0, count)
        self._stem = np.full(count, 50.0)
        self._pv = np.full(count, 50.0)
        self._seconds = 0
        self.image = b""
        self.step()

    def step(self) -> None:
        """One second: OP moves as a triangle, the stem follows when it slips, PV follows it."""
        turn = (self._phase + self._seconds / self._length) % 1.0
        op = 50.0 + 12.0 * np.abs(2.0 * turn - 1.0)
        error = op - self._stem
        self._stem = np.where(np.abs(error) > 2.5, op - 1.5 * np.sign(error), self._stem)
        self._pv += 0.3 * (self._stem - self._pv)
        shown = self._pv + 0.05 * self._rng.standard_normal(op.size)
        self._seconds += 1
        self.image = np.column_stack([op, shown]).astype(">f4").tobytes()


class Served(asyncio.Protocol):
    """One connection."""

    def __init__(self, loops: Loops) -> None:
        self._loops = loops
        self._buffer = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Answer every whole request."""
        self._buffer += data
        while len(self._buffer) >= 12:
            transaction, _, _, unit, function, address, count = struct.unpack_from(
                ">HHHBBHH", self._buffer
            )
            self._buffer = self._buffer[12:]
            body = self._loops.image[2 * address : 2 * (address + count)]
            if function != 3 or len(body) != 2 * count:
                answer = struct.pack(">HHHBBB", transaction, 0, 3, unit, function | 0x80, 2)
            else:
                size = len(body)
                answer = struct.pack(">HHHBBB", transaction, 0, size + 3, unit, 3, size) + body
            self._transport.write(answer)


async def serve(ports: int, loops: int) -> None:
    """Serve until the process is ended."""
    plants = [Loops(loops, seed) for seed in range(ports)]
    running = asyncio.get_running_loop()
    numbers = []
    for plant in plants:
        server = await running.create_server(lambda plant=plant: Served(plant), "127.0.0.1", 0)
        numbers.append(server.sockets[0].getsockname()[1])
    print(*numbers, flush=True)
    deadline = running.time()
    while True:
        deadline += 1.0
        await asyncio.sleep(max(0.0, deadline - running.time()))
        for plant in plants:
            plant.step()


if __name__ == "__main__":
    asyncio.run(serve(int(sys.argv[1]), int(sys.argv[2])))
