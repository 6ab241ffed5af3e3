"""A proxy between the daemon and a PLC that does to replies what networks and devices do.

Faults come by count, not by time: the next replies get the next faults of a schedule, and when it
is used up everything passes. Frames are taken apart with code that shares nothing with the links.
"""

from __future__ import annotations

import asyncio
import random
import socket
import struct
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import Enum

from tests.faults.plant import frame, read_request
from tests.loopback import LoopbackServer


class Fault(Enum):
    """What becomes of a reply."""

    LATE = "it comes after the time-out"
    DROPPED = "it never comes"
    HALF_OPEN = "the connection stays open and dead"
    RESET = "the connection is reset"
    CLOSED = "the connection is closed"
    REFUSED = "the connection is closed, and the next one is refused"
    GARBAGE = "other bytes come"
    TRUNCATED = "only its first half comes"
    SPLIT = "it comes in pieces"
    DOUBLED = "it comes twice in one segment"
    HELD = "it is kept back and comes in one segment with the next one that passes"
    EXCEPTION = "the device answers with an exception"
    # Only where there is a transaction id:
    WRONG_TRANSACTION = "it has the id of another request"
    ZERO_TRANSACTION = "it has the id 0"
    OLD = "the reply to an earlier request comes again instead"
    MERGED = "an earlier reply comes before it in the same segment"
    WRONG_UNIT = "it is of another unit"
    # Only where there is a checksum:
    BAD_CHECKSUM = "a bit of it has changed"


TCP_FAULTS = tuple(fault for fault in Fault if fault is not Fault.BAD_CHECKSUM)
RTU_FAULTS = (
    Fault.LATE, Fault.DROPPED, Fault.HALF_OPEN, Fault.RESET, Fault.CLOSED, Fault.REFUSED,
    Fault.GARBAGE, Fault.TRUNCATED, Fault.SPLIT, Fault.DOUBLED, Fault.HELD, Fault.EXCEPTION,
    Fault.BAD_CHECKSUM,
)  # fmt: skip
OF_CONNECTIONS = frozenset({Fault.HALF_OPEN, Fault.RESET, Fault.CLOSED, Fault.REFUSED})
SERIAL_FAULTS = tuple(fault for fault in RTU_FAULTS if fault not in OF_CONNECTIONS)
"""Faults of a line that has no connections."""
HARMLESS = frozenset({Fault.SPLIT, Fault.DOUBLED})
"""Faults after which the reply has arrived all the same."""
SILENT = frozenset({Fault.LATE, Fault.DROPPED, Fault.HALF_OPEN, Fault.TRUNCATED, Fault.HELD})
"""Faults after which the daemon waits for its whole time-out."""

EXCEPTIONS = (5, 6, 10, 11)
"""Acknowledge, busy, and the two of gateways; those that blame an address are a quarantine's."""


@dataclass
class FaultProxy(LoopbackServer):
    """Listens on ``port`` once started.

    Args:
        upstream: the PLC's port.
        framing: ``tcp`` or ``rtu``.
        timeout: the daemon's time-out in seconds.
        others: counts the requests to the other devices.
        seed: of the bytes and bits that are not prescribed.

    Attributes:
        attempts: connections after the last fault until a reply passed.
        answered: whether a reply has passed since the last fault.
        done: faults that were really done, by their number.
        alone: silences in which ``others`` did not count: no other request was sent meanwhile.
    """

    upstream: int
    framing: str
    timeout: float
    others: Callable[[], int]
    seed: int = 1
    attempts: int = 0
    answered: bool = False
    alone: int = 0
    done: Counter[Fault] = field(default_factory=Counter)
    _faults: deque[Fault | None] = field(default_factory=deque)
    _refuse: int = 0
    _silent_since: int | None = None
    _held: bytes = b""
    _old: deque[bytes] = field(default_factory=lambda: deque(maxlen=7))

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)

    def schedule(self, faults: Iterable[Fault | None]) -> None:
        """Do these to the next replies, one each; None lets a reply pass."""
        self._faults.extend(faults)
        self.attempts, self.answered = 0, False

    @property
    def over(self) -> bool:
        """Whether the schedule is used up."""
        return not self._faults and not self._refuse

    @property
    def _harmless(self) -> bool:
        """Whether no fault is left."""
        return not any(self._faults) and not self._refuse

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._end_silence()
        if self._harmless and not self.answered:
            self.attempts += 1
        if self._refuse:
            self._refuse -= 1
            _reset(writer)
            return
        up, down = await asyncio.open_connection("127.0.0.1", self.upstream)
        try:
            while True:
                transaction, unit, pdu = await read_request(reader, self.framing)
                self._end_silence()
                down.write(self._request(transaction, unit, pdu))
                reply = await self._reply(up)
                fault = self._faults.popleft() if self._faults else None
                if fault is None:
                    self.answered = self._harmless
                    writer.write(self._held + reply)
                    self._held = b""
                else:
                    self.done[fault] += 1
                    if fault in SILENT:
                        self._silent_since = self.others()
                    if not await self._harm(fault, writer, reply, pdu, unit, transaction):
                        return
                self._old.append(reply)
                await writer.drain()
        finally:
            down.close()

    def _end_silence(self) -> None:
        """Take note that the daemon asks again: what has it done while it waited?"""
        if self._silent_since is not None:
            self.alone += self.others() == self._silent_since
            self._silent_since = None

    def _request(self, transaction: int, unit: int, pdu: bytes) -> bytes:
        return frame(self.framing, transaction, unit, pdu)

    async def _reply(self, up: asyncio.StreamReader) -> bytes:
        if self.framing == "tcp":
            head = await up.readexactly(7)
            return head + await up.readexactly(struct.unpack(">H", head[4:6])[0] - 1)
        head = await up.readexactly(3)
        if head[1] == 8:
            return head + await up.readexactly(5)
        return head + await up.readexactly(head[2] + 2)

    async def _harm(
        self,
        fault: Fault,
        writer: asyncio.StreamWriter,
        reply: bytes,
        request: bytes,
        unit: int,
        transaction: int,
    ) -> bool:
        """Do what the fault says; False when the connection is over."""
        old = self._old[0] if self._old else reply[::-1]
        match fault:
            case Fault.LATE:
                await asyncio.sleep(1.5 * self.timeout)
                writer.write(reply)
            case Fault.DROPPED:
                pass
            case Fault.HELD:
                self._held += reply
            case Fault.HALF_OPEN:
                await asyncio.sleep(20.0 * self.timeout)
                return False
            case Fault.RESET:
                _reset(writer)
                return False
            case Fault.CLOSED:
                return False
            case Fault.REFUSED:
                self._refuse += 1
                return False
            case Fault.GARBAGE:
                writer.write(self._random.randbytes(self._random.randint(1, 300)))
            case Fault.TRUNCATED:
                writer.write(reply[: len(reply) // 2])
            case Fault.SPLIT:
                for at in range(0, len(reply), 5):
                    writer.write(reply[at : at + 5])
                    await writer.drain()
                    await asyncio.sleep(0.001)
            case Fault.DOUBLED:
                writer.write(reply + reply)
            case Fault.EXCEPTION:
                pdu = bytes([request[0] | 0x80, self._random.choice(EXCEPTIONS)])
                writer.write(self._request(transaction, unit, pdu))
            case Fault.WRONG_TRANSACTION:
                writer.write(struct.pack(">H", (transaction + 1) & 0xFFFF) + reply[2:])
            case Fault.ZERO_TRANSACTION:
                writer.write(b"\0\0" + reply[2:])
            case Fault.OLD:
                writer.write(old)
            case Fault.MERGED:
                writer.write(old + reply)
            case Fault.WRONG_UNIT:
                writer.write(reply[:6] + bytes([unit + 1]) + reply[7:])
            case Fault.BAD_CHECKSUM:
                at = self._random.randrange(3, len(reply))
                changed = reply[at] ^ (1 << self._random.randrange(8))
                writer.write(reply[:at] + bytes([changed]) + reply[at + 1 :])
        return True


def _reset(writer: asyncio.StreamWriter) -> None:
    """Close so that the other end sees a reset."""
    linger = struct.pack("ii", 1, 0)
    writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
    writer.transport.abort()
