"""A Modbus TCP device in a few lines, independent of pymodbus, with faults to switch on."""

from __future__ import annotations

import asyncio
import ssl
import struct
from collections.abc import Callable
from dataclasses import dataclass, field

READ_BITS, READ_WORDS, WRITES = (1, 2), (3, 4), (6, 16)


@dataclass
class FakeDevice:
    """Holding and input registers share ``words``, coils and discrete inputs share ``bits``."""

    unit: int = 1
    words: list[int] = field(default_factory=lambda: [0] * 400)
    bits: list[int] = field(default_factory=lambda: [0] * 400)
    illegal: set[int] = field(default_factory=set)
    exception: int | None = None
    """Answer everything with this exception code."""
    delay: float = 0.0
    """Seconds from request to reply."""
    gate: asyncio.Event = field(default_factory=asyncio.Event)
    """Replies wait until it is set, as it is in the beginning."""
    mute: bool = False
    """Read requests and say nothing."""
    longest: int = 0xFFFF
    """Say nothing to a request of more registers."""
    accepts: bool = True
    """Otherwise every connection is closed at once, as by an access list."""
    closes: bool = False
    """Close the connection, in order, after each answer."""
    tamper: Callable[[bytes], bytes] | None = None
    """Changes a whole reply frame on its way out; an empty result drops the connection."""
    after_write: Callable[[], None] | None = None
    """Called when a write was carried out, like a PLC's program."""
    tls: ssl.SSLContext | None = None
    port: int = 0
    requests: list[tuple[int, int, int]] = field(default_factory=list)
    """(function, address, count) of every request."""
    writes: list[tuple[int, int, list[int]]] = field(default_factory=list)
    """(function, address, words) of every write that was carried out."""
    connections: int = 0
    _server: asyncio.Server | None = None
    _clients: set[asyncio.Task[None]] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.gate.set()

    async def start(self) -> None:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self.port, ssl=self.tls)
        self.port = self._server.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None
        clients = list(self._clients)
        for client in clients:
            client.cancel()
        await asyncio.gather(*clients, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._clients.add(task)
        self.connections += 1
        try:
            while self.accepts:
                header = await reader.readexactly(7)
                transaction, _, length, unit = struct.unpack(">HHHB", header)
                body = await reader.readexactly(length - 1)
                answer = self._answer(body)
                delay, mute = self.delay, self.mute
                if mute or unit != self.unit or self.requests[-1][2] > self.longest:
                    continue
                await asyncio.sleep(delay)
                await self.gate.wait()
                frame = struct.pack(">HHHB", transaction, 0, len(answer) + 1, unit) + answer
                frame = self.tamper(frame) if self.tamper else frame
                if not frame:
                    return
                writer.write(frame)
                await writer.drain()
                if self.closes:
                    return
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            # The stream's own callback would report a cancellation as an error.
            return
        finally:
            self._clients.discard(task)
            writer.close()

    def _answer(self, body: bytes) -> bytes:
        function, address, count = struct.unpack(">BHH", body[:5])
        if function == 6:
            values, count = [count], 1
        elif function == 16:
            values = list(struct.unpack(f">{count}H", body[6:]))
        self.requests.append((function, address, count))
        if self.exception is not None:
            return bytes([function | 0x80, self.exception])
        if self.illegal & set(range(address, address + count)):
            return bytes([function | 0x80, 2])
        if function in WRITES:
            self.words[address : address + count] = values
            self.writes.append((function, address, values))
            if self.after_write:
                self.after_write()
            return body[:5]
        if function in READ_BITS:
            bits = self.bits[address : address + count]
            packed = bytes(
                sum(bit << k for k, bit in enumerate(bits[i : i + 8])) for i in range(0, count, 8)
            )
            return bytes([function, len(packed)]) + packed
        words = self.words[address : address + count]
        return struct.pack(f">BB{count}H", function, 2 * count, *words)
