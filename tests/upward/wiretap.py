"""A tap between the daemon and the broker: takes MQTT 3.1.1 and 5 packets apart as they pass.

Written from the OASIS standards, sections 2 and 3; it shares nothing with the client.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

from tests.loopback import LoopbackServer

CONNECT, PUBLISH, PUBACK, SUBSCRIBE, DISCONNECT = 1, 3, 4, 8, 14


@dataclass(frozen=True)
class Packet:
    """One packet; for CONNECT topic, payload, qos and retain are those of the will."""

    kind: int
    topic: str = ""
    payload: bytes = b""
    qos: int = 0
    retain: bool = False
    number: int = 0
    clean: bool = False
    topics: tuple[tuple[str, int], ...] = ()


@dataclass
class Connection:
    """What the daemon sent in one connection, and which numbers the broker acknowledged."""

    sent: list[Packet] = field(default_factory=list)
    acknowledged: set[int] = field(default_factory=set)
    client_id: str = ""
    level: int = 4
    under_way: int = 0
    most_under_way: int = 0
    refused: dict[int, int] = field(default_factory=dict)

    @property
    def published(self) -> list[Packet]:
        return [packet for packet in self.sent if packet.kind == PUBLISH]


@dataclass
class WireTap(LoopbackServer):
    """Passes bytes on to ``broker`` and keeps what it saw."""

    broker: int = 0
    connections: list[Connection] = field(default_factory=list)

    def of(self, suffix: str) -> list[Connection]:
        """Connections whose client id ends so."""
        return [found for found in self.connections if found.client_id.endswith(suffix)]

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connection = Connection()
        self.connections.append(connection)
        try:
            back_reader, back_writer = await asyncio.open_connection("127.0.0.1", self.broker)
        except ConnectionError:
            # CONNECT is seen all the same.
            with contextlib.suppress(ConnectionError, asyncio.IncompleteReadError):
                _, head, body = await _read(reader)
                _note(connection, head, body)
            writer.close()
            return
        up = asyncio.create_task(_pass_on(reader, back_writer, partial(_note, connection)))
        down = asyncio.create_task(_pass_on(back_reader, writer, partial(_answer, connection)))
        try:
            await asyncio.wait([up, down], return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (up, down):
                task.cancel()
            await asyncio.gather(up, down, return_exceptions=True)
            for stream in (writer, back_writer):
                stream.close()
            for stream in (writer, back_writer):
                with contextlib.suppress(ConnectionError):
                    await stream.wait_closed()


async def _pass_on(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, note: Callable[[int, bytes], None]
) -> None:
    while True:
        raw, head, body = await _read(reader)
        writer.write(raw)
        await writer.drain()
        note(head, body)


async def _read(reader: asyncio.StreamReader) -> tuple[bytes, int, bytes]:
    """Read one packet: all of it, its first byte, and what follows its length."""
    raw = head = await reader.readexactly(1)
    size = 0
    for shift in range(0, 28, 7):
        byte = await reader.readexactly(1)
        raw += byte
        size |= (byte[0] & 0x7F) << shift
        if byte[0] < 0x80:
            break
    body = await reader.readexactly(size)
    return raw + body, head[0], body


def _answer(connection: Connection, head: int, body: bytes) -> None:
    if head >> 4 == PUBACK:
        number = int.from_bytes(body[:2])
        connection.under_way -= 1
        # MQTT 5, 3.4.2.1: without a reason code it is success.
        if len(body) > 2 and body[2] >= 0x80:
            connection.refused[number] = body[2]
        else:
            connection.acknowledged.add(number)


def _note(connection: Connection, head: int, body: bytes) -> None:
    kind = head >> 4
    if kind == CONNECT:
        connection.level, connection.client_id, found = _connect(body)
    elif kind == PUBLISH:
        found = _publish(head, body, connection.level)
        connection.under_way += found.qos > 0
        connection.most_under_way = max(connection.most_under_way, connection.under_way)
    elif kind == SUBSCRIBE:
        at = _after_properties(body, 2, connection.level)
        found = Packet(SUBSCRIBE, topics=tuple(_filters(body[at:])))
    else:
        found = Packet(kind)
    connection.sent.append(found)


def _text(body: bytes, at: int) -> tuple[bytes, int]:
    size = int.from_bytes(body[at : at + 2])
    return body[at + 2 : at + 2 + size], at + 2 + size


def _after_properties(body: bytes, at: int, level: int) -> int:
    """Where properties that begin at ``at`` end (MQTT 5, 2.2.2); 3.1.1 has none."""
    if level < 5:
        return at
    # The tests' own properties are short: their length is one byte.
    assert body[at] < 0x80
    return at + 1 + body[at]


def _connect(body: bytes) -> tuple[int, str, Packet]:
    protocol, at = _text(body, 0)
    level, flags = body[at], body[at + 1]
    assert protocol == b"MQTT"
    assert level in (4, 5)
    client, at = _text(body, _after_properties(body, at + 4, level))
    topic = payload = b""
    if flags & 0x04:
        at = _after_properties(body, at, level)
        topic, at = _text(body, at)
        payload, at = _text(body, at)
    will = Packet(
        CONNECT, topic.decode(), payload, flags >> 3 & 3, bool(flags & 0x20), clean=bool(flags & 2)
    )
    return level, client.decode(), will


def _publish(head: int, body: bytes, level: int) -> Packet:
    topic, at = _text(body, 0)
    qos = head >> 1 & 3
    number = 0
    if qos:
        number, at = int.from_bytes(body[at : at + 2]), at + 2
    at = _after_properties(body, at, level)
    return Packet(PUBLISH, topic.decode(), body[at:], qos, bool(head & 1), number)


def _filters(body: bytes) -> Iterator[tuple[str, int]]:
    at = 0
    while at < len(body):
        name, at = _text(body, at)
        yield name.decode(), body[at]
        at += 1
