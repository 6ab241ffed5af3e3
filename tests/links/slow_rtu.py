"""An RTU device in a few lines, independent of pymodbus: answers in order, and when it likes."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from dataclasses import dataclass, field

from tests.loopback import LoopbackServer
from tests.wire_bytes import crc


@dataclass
class SlowRtu(LoopbackServer):
    """Holding register n holds n. One server of RTU frames over TCP.

    ``delay`` gives the seconds that the next request takes, and no answer leaves while ``gate`` is
    not set. Requests queue behind one another, as in a device with one processor, and answers
    outlive the connection, as behind a gateway.
    """

    unit: int = 1
    delay: Callable[[], float] = lambda: 0.0
    gate: asyncio.Event = field(default_factory=asyncio.Event)
    echoes: str = "answered"
    """What becomes of FC8: ``answered``, ``refused`` (exception 1) or ``ignored``."""
    illegal: set[int] = field(default_factory=set)
    requests: list[bytes] = field(default_factory=list)
    _queue: asyncio.Queue[bytes] = field(default_factory=asyncio.Queue)
    _writer: asyncio.StreamWriter | None = None

    def __post_init__(self) -> None:
        self.gate.set()

    async def start(self) -> None:
        await super().start()
        self._tasks.add(asyncio.create_task(self._work()))

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        # The newest client hears everything, as on a gateway in transparent mode.
        self._writer = writer
        while True:
            frame = await reader.readexactly(8)
            assert crc(frame[:6]) == frame[6:]
            self.requests.append(frame)
            self._queue.put_nowait(frame)

    async def _work(self) -> None:
        while True:
            frame = await self._queue.get()
            await asyncio.sleep(self.delay())
            await self.gate.wait()
            answer = self._answer(frame)
            if answer and self._writer is not None and not self._writer.is_closing():
                self._writer.write(answer + crc(answer))

    def _answer(self, frame: bytes) -> bytes:
        unit, function, address, count = struct.unpack(">BBHH", frame[:6])
        if unit != self.unit:
            return b""
        if function == 8:
            refusal = bytes((unit, 0x88, 1))
            return {"answered": frame[:6], "refused": refusal, "ignored": b""}[self.echoes]
        if self.illegal & set(range(address, address + count)):
            return bytes((unit, function | 0x80, 2))
        return struct.pack(
            f">BBB{count}H", unit, function, 2 * count, *range(address, address + count)
        )
