"""A PLC for `benchmarks.kills`: a sticky loop, a block reader, and a watch on every write.

It serves Modbus TCP with code that shares nothing with the daemon's links, runs the block reader at
every cycle as a real PLC would, and checks after each single request that what it has accepted is
still there, whole.
"""

from __future__ import annotations

import asyncio
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from fieldlink.registers import (
    BLOCK_REGISTERS,
    Bank,
    BlockError,
    BlockReader,
    ExchangeLayout,
    decode_block,
    is_newer,
)

__all__ = ["CYCLE", "LAYOUT", "LOOP_ID", "WatchedPlc"]

CYCLE = 0.01
"""Wall seconds of a controller cycle, which is one plant second."""

LOOP_ID = 101
LAYOUT = ExchangeLayout.at(100)


@dataclass
class WatchedPlc:
    """Listens on ``port`` once started.

    Attributes:
        accepted: sequence numbers of the blocks accepted, in order.
        faults: what must never be, in words.
        on_write: called with the function code after each write was carried out, before its reply.
    """

    port: int = 0
    words: list[int] = field(default_factory=lambda: [0] * 400)
    accepted: list[int] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    writes: int = 0
    on_write: Callable[[int], None] | None = None
    _cycle: int = 0
    _stem: float = 50.0
    _pv: float = 50.0
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)
    _server: asyncio.Server | None = None

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(3)
        self._reader = BlockReader(LOOP_ID)
        self.words[LAYOUT.enable] = 1

    async def start(self) -> None:
        """Listen, and run the controller."""
        self._scan()
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]
        self._tasks.add(asyncio.create_task(self._run()))

    async def stop(self) -> None:
        """Stop both."""
        assert self._server is not None
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _run(self) -> None:
        deadline = time.monotonic()
        while True:
            self._scan()
            # A machine that stands still holds up the plant, too: no cycle is made up for, which a
            # poll could not have seen.
            now, deadline = time.monotonic(), deadline + CYCLE
            if deadline < now + 0.5 * CYCLE:
                deadline = now + CYCLE
            await asyncio.sleep(deadline - now)

    def _scan(self) -> None:
        """One cycle: the plant moves, the block reader looks at the registers."""
        op = 50.0 + 6.0 * abs((self._cycle / 40.0) % 2.0 - 1.0)
        if op - self._stem > 2.5:
            self._stem = op - 1.5
        elif self._stem - op > 2.5:
            self._stem = op + 1.5
        pv = self._pv + 0.02 * self._rng.standard_normal()
        self._pv += 0.3 * (self._stem - self._pv)
        self._cycle += 1
        self.words[0:5] = [
            *struct.unpack(">2H", struct.pack(">f", op)),
            *struct.unpack(">2H", struct.pack(">f", pv)),
            self._cycle & 0xFFFF,
        ]
        view = LAYOUT.view(lambda address, count: self.words[address : address + count])
        state = self._reader.scan(view, float(self._cycle))
        for address, word in state.reply(LAYOUT).items():
            self.words[address] = word
        acknowledged = self.words[LAYOUT.ack_seq]
        if acknowledged and (not self.accepted or self.accepted[-1] != acknowledged):
            if self.accepted and not is_newer(acknowledged, self.accepted[-1]):
                self.faults.append(f"block {acknowledged} was taken after {self.accepted[-1]}")
            self.accepted.append(acknowledged)
        self._check()

    def _check(self) -> None:
        """The active bank must hold the acknowledged block, whole, whatever was written since."""
        acknowledged = self.words[LAYOUT.ack_seq]
        if not acknowledged:
            return
        bank = Bank(self.words[LAYOUT.active_bank])
        first = LAYOUT.bank_address(bank)
        try:
            held = decode_block(self.words[first : first + BLOCK_REGISTERS])
        except BlockError as error:
            self.faults.append(f"the active bank {bank.name} cannot be read: {error}")
            return
        if held.seq != acknowledged:
            self.faults.append(f"the active bank holds {held.seq}, accepted was {acknowledged}")

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        try:
            while True:
                head = await reader.readexactly(7)
                transaction, _, length, unit = struct.unpack(">HHHB", head)
                answer = self._answer(await reader.readexactly(length - 1))
                frame = struct.pack(">HHHB", transaction, 0, len(answer) + 1, unit)
                writer.write(frame + answer)
                await writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            return
        finally:
            self._tasks.discard(task)
            writer.close()

    def _answer(self, body: bytes) -> bytes:
        function, address, count = struct.unpack(">BHH", body[:5])
        if function == 3:
            words = self.words[address : address + count]
            return struct.pack(f">BB{count}H", 3, 2 * count, *words)
        if function == 6:
            self.words[address] = count
        elif function == 16:
            self.words[address : address + count] = struct.unpack(f">{count}H", body[6:])
        else:
            return bytes([function | 0x80, 1])
        self.writes += 1
        self._check()
        if self.on_write is not None:
            self.on_write(function)
        return body[:5]
