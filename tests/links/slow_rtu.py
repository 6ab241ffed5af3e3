"""An RTU device in a few lines, independent of pymodbus: answers in order, and when it likes."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from dataclasses import dataclass, field


def crc(data: bytes) -> bytes:
    """The CRC of Modbus over serial line (V1.02, appendix B), bit by bit."""
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = (register >> 1) ^ 0xA001 if register & 1 else register >> 1
    return struct.pack("<H", register)


@dataclass
class SlowRtu:
    """Holding register n holds n. One server of RTU frames over TCP.

    ``delay`` gives the seconds that the next request takes; requests queue behind one another, as
    in a device with one processor, and answers outlive the connection, as behind a gateway.
    """

    unit: int = 1
    delay: Callable[[], float] = lambda: 0.0
    echoes: str = "answered"
    """What becomes of FC8: ``answered``, ``refused`` (exception 1) or ``ignored``."""
    illegal: set[int] = field(default_factory=set)
    port: int = 0
    requests: list[bytes] = field(default_factory=list)
    _queue: asyncio.Queue[bytes] = field(default_factory=asyncio.Queue)
    _writer: asyncio.StreamWriter | None = None
    _server: asyncio.Server | None = None
    _tasks: list[asyncio.Task[None]] = field(default_factory=list)

    async def start(self) -> None:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]
        self._tasks.append(asyncio.create_task(self._work()))

    async def stop(self) -> None:
        assert self._server is not None
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._writer is not None:
            self._writer.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.append(task)
        # The newest client hears everything, as on a gateway in transparent mode.
        self._writer = writer
        try:
            while True:
                frame = await reader.readexactly(8)
                assert crc(frame[:6]) == frame[6:]
                self.requests.append(frame)
                self._queue.put_nowait(frame)
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            return
        finally:
            writer.close()

    async def _work(self) -> None:
        while True:
            frame = await self._queue.get()
            await asyncio.sleep(self.delay())
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
