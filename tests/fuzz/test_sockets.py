"""Whatever comes from a socket: no crash, no hang, and no value that was not in a valid reply."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Awaitable, Callable, Iterator
from itertools import repeat
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.framer import FramerType
from pymodbus.transport import CommParams, CommType

from fieldlink.lab.plc import Listening
from fieldlink.lab.plc.image import RegisterImage
from fieldlink.lab.plc.listening import listen
from fieldlink.lab.plc.modbus_device import modbus_device, other_units
from fieldlink.links import SystemClock
from fieldlink.links.backoff import BackoffSettings
from fieldlink.links.frames import (
    Framing,
    MbapFraming,
    Request,
    RtuFraming,
    read_request,
    write_many_request,
    write_one_request,
)
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.links.wire import Wire, WireLostError, WrongReplyError
from fieldlink.registers import DataType, Table, Tag, plan_reads
from fieldlink.site import Device
from tests.wire_bytes import crc

HOST = "127.0.0.1"
UNIT, TRANSACTION = 1, 1

MANY = settings(max_examples=300, suppress_health_check=[HealthCheck.too_slow])
SOME = settings(max_examples=20, suppress_health_check=[HealthCheck.too_slow])

REQUESTS = st.sampled_from(
    [
        read_request(Table.HOLDING, 10, 2),
        read_request(Table.INPUT, 0, 125),
        read_request(Table.COIL, 3, 13),
        write_one_request(7, 99),
        write_many_request(7, [1, 2, 3]),
    ]
)


@st.composite
def replies(draw: st.DrawFn) -> tuple[Request, bytes]:
    """A request and a regular answer to it with arbitrary data."""
    request = draw(REQUESTS)
    size = request.size - len(request.head)
    return request, request.head + draw(st.binary(min_size=size, max_size=size))


def mbap(pdu: bytes, unit: int = UNIT, transaction: int = TRANSACTION, protocol: int = 0) -> bytes:
    return struct.pack(">HHHB", transaction, protocol, len(pdu) + 1, unit) + pdu


def rtu(pdu: bytes, unit: int = UNIT) -> bytes:
    return bytes((unit,)) + pdu + crc(bytes((unit,)) + pdu)


@st.composite
def streams(draw: st.DrawFn, frame: Callable[[bytes], bytes], pdu: bytes) -> list[bytes]:
    """Chunks made of the right reply and of everything that goes wrong with one."""
    wrong = [
        frame(pdu)[: draw(st.integers(0, len(frame(pdu))))],
        frame(pdu) + frame(pdu),
        frame(pdu[:-1]),
        frame(pdu + b"\0"),
        frame(bytes((pdu[0] | 0x80, draw(st.integers(0, 255))))),
        frame(draw(st.binary(min_size=1, max_size=8))),
        draw(st.binary(max_size=30)),
    ]
    if frame is mbap:
        numbers = st.integers(0, 0xFFFF)
        wrong += [mbap(pdu, transaction=draw(numbers)), mbap(pdu, protocol=draw(numbers))]
        wrong += [mbap(pdu, unit=draw(st.integers(0, 255)))]
    else:
        wrong += [rtu(pdu, unit=draw(st.integers(0, 255))), rtu(pdu)[:-1] + b"\0"]
    parts = draw(st.lists(st.sampled_from([frame(pdu), *wrong]), max_size=4))
    stream = b"".join(parts)
    cuts = sorted(draw(st.lists(st.integers(0, len(stream)), max_size=4)))
    return [stream[a:b] for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]


@pytest.fixture(scope="module", autouse=True)
def known_transaction() -> Iterator[None]:
    """Every request of these tests has the transaction id that the streams are made with."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fieldlink.links.wire._TRANSACTIONS", repeat(TRANSACTION))
        yield


class Plug:
    """A transport that goes nowhere."""

    def write(self, data: bytes) -> None:
        self.sent = data

    def close(self) -> None:
        self.closed = True


async def answer(
    framing: Framing, kind: CommType, request: Request, chunks: list[bytes]
) -> bytes | None:
    """Return what the wire takes for the answer when these chunks arrive, None for nothing."""
    wire = Wire(CommParams(comm_type=kind, host=HOST, port=1), framing)
    plug: Any = Plug()
    wire.transport = plug
    task = asyncio.create_task(wire.exchange(UNIT, request, 60.0))
    await asyncio.sleep(0)
    for chunk in chunks:
        wire.data_received(chunk)
    wire.callback_disconnected(None)
    try:
        return await task
    except (WireLostError, WrongReplyError):
        return None


@pytest.mark.parametrize(
    ("framing", "kind", "frame"),
    [(MbapFraming(), CommType.TCP, mbap), (RtuFraming(), CommType.TCP, rtu)],
    ids=["mbap", "rtu"],
)
@MANY
@given(data=st.data())
def test_what_is_taken_was_a_whole_frame_of_the_answer(
    framing: Framing, kind: CommType, frame: Callable[[bytes], bytes], data: st.DataObject
) -> None:
    request, pdu = data.draw(replies())
    chunks = data.draw(streams(frame, pdu))
    taken = asyncio.run(answer(framing, kind, request, chunks))
    if taken is not None:
        assert frame(taken) in b"".join(chunks)
        assert request.is_regular(taken) or request.is_exception(taken)


@pytest.mark.parametrize(
    ("framing", "frame"), [(MbapFraming(), mbap), (RtuFraming(), rtu)], ids=["mbap", "rtu"]
)
@MANY
@given(data=st.data())
def test_the_answer_alone_is_taken_however_it_is_cut(
    framing: Framing, frame: Callable[[bytes], bytes], data: st.DataObject
) -> None:
    request, pdu = data.draw(replies())
    stream = frame(pdu)
    cut = data.draw(st.integers(0, len(stream)))
    noise = data.draw(st.sampled_from([b"", b"\0", b"\xff\0"])) if frame is rtu else b""
    chunks = [noise + stream[:cut], stream[cut:]]
    assert asyncio.run(answer(framing, CommType.TCP, request, chunks)) == pdu


@pytest.mark.parametrize("link", ["modbus-tcp", "modbus-rtu-tcp"])
@SOME
@given(chunks=st.lists(st.binary(min_size=1, max_size=40), min_size=1, max_size=6))
def test_a_server_that_answers_arbitrary_bytes(link: str, chunks: list[bytes]) -> None:
    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            for chunk in chunks:
                await reader.readexactly(8)
                writer.write(chunk)
                await writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError):
            return
        finally:
            writer.close()

    async def work() -> None:
        server = await asyncio.start_server(serve, HOST, 0)
        device = Device(
            link=link,  # type: ignore[arg-type]
            host=HOST,
            port=server.sockets[0].getsockname()[1],
            timeout=0.02,
            register_map=Path("none"),
        )
        tag = Tag("T", Table.HOLDING, 0, DataType.UINT16)
        soon = BackoffSettings(first=1e-6, cap=1e-6)
        client = ModbusLink(
            ModbusSettings("plc", device, backoff=soon), plan_reads([tag]), SystemClock()
        )
        for _ in range(3):
            assert not (await client.scan())["T"].good
        await client.close()
        server.close()
        await server.wait_closed()

    run_quietly(work)


@pytest.mark.parametrize("link", ["modbus-tcp", "modbus-rtu-tcp", "modbus-udp"])
@SOME
@given(
    chunks=st.lists(
        st.binary(min_size=1, max_size=300)
        | st.binary(min_size=1, max_size=12).map(mbap)
        | st.binary(min_size=1, max_size=12).map(rtu),
        min_size=1,
        max_size=5,
    )
)
def test_a_client_that_sends_arbitrary_bytes(link: str, chunks: list[bytes]) -> None:
    async def work() -> None:
        image = RegisterImage()
        image.define(Table.HOLDING, 10, 2)
        image.put(Table.HOLDING, 10, [7, 8])
        devices = [modbus_device(image, 1)]
        if link != "modbus-rtu-tcp":
            devices.append(other_units())
        server, port = await listen(devices, Listening(link=link))
        try:
            await send(link, port, chunks)
            assert await sane_read(link, port) == [7, 8]
        finally:
            await server.shutdown()  # type: ignore[no-untyped-call]
            await asyncio.sleep(0)

    run_quietly(work)


async def send(link: str, port: int, chunks: list[bytes]) -> None:
    if link == "modbus-udp":
        loop = asyncio.get_running_loop()
        transport, _ = await loop.create_datagram_endpoint(
            asyncio.DatagramProtocol, remote_addr=(HOST, port)
        )
        for chunk in chunks:
            transport.sendto(chunk)
            await asyncio.sleep(0)
        transport.close()
        return
    _, writer = await asyncio.open_connection(HOST, port)
    try:
        for chunk in chunks:
            writer.write(chunk)
            await writer.drain()
            await asyncio.sleep(0)
    except ConnectionError:
        # The server may drop a client that makes no sense.
        return
    finally:
        writer.close()


async def sane_read(link: str, port: int) -> list[int]:
    if link == "modbus-udp":
        device = Device(
            link="modbus-udp", host=HOST, port=port, timeout=5.0, register_map=Path("none")
        )
        client = ModbusLink(ModbusSettings("plc", device), (), SystemClock())
        try:
            return await client.read_registers(10, 2)
        finally:
            await client.close()
    framer = FramerType.RTU if link == "modbus-rtu-tcp" else FramerType.SOCKET
    bare = AsyncModbusTcpClient(HOST, port=port, framer=framer, timeout=5.0, retries=0)
    await bare.connect()
    try:
        return list((await bare.read_holding_registers(10, count=2)).registers)
    finally:
        bare.close()


def run_quietly(work: Callable[[], Awaitable[None]]) -> None:
    """Run ``work``; an exception that nobody caught inside the event loop fails the test."""
    unhandled: list[dict[str, Any]] = []

    async def watched() -> None:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _loop, context: unhandled.append(context))
        await asyncio.wait_for(work(), 30.0)

    asyncio.run(watched())
    assert unhandled == []
