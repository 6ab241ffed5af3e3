"""What devices do for a moment: a closed connection, a burst of exceptions, a refused setting."""

from __future__ import annotations

import asyncio
import os
import struct
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from fieldlink.links import LinkState, Quality, SystemClock, VirtualClock
from fieldlink.links.backoff import BackoffSettings
from fieldlink.links.clock import Clock
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.links.wire import Wire
from fieldlink.registers import DataType, Table, Tag, plan_reads
from fieldlink.site import Device
from tests.links.patience import PATIENCE
from tests.loopback import LoopbackServer
from tests.wire_bytes import crc

if TYPE_CHECKING:
    from tests.links.fake_device import FakeDevice

FAR_APART = [Tag(f"T{i}", Table.HOLDING, 50 * i, DataType.UINT16) for i in range(7)]
"""Seven tags, each in a request of its own."""


def link_to(
    port: int,
    tags: list[Tag],
    clock: Clock | None = None,
    kind: str = "modbus-tcp",
    timeout: float = PATIENCE,
) -> ModbusLink:
    device = Device.model_validate(
        {
            "link": kind,
            "host": "127.0.0.1",
            "port": port,
            "timeout": timeout,
            "register_map": "m.csv",
        }
    )
    backoff = BackoffSettings(first=600.0, cap=600.0)
    settings = ModbusSettings("plc", device, backoff=backoff, writable=((0, 9),))
    return ModbusLink(settings, plan_reads(tags), clock or SystemClock())


async def test_a_device_that_closes_after_each_answer_is_read_as_a_whole(
    device: FakeDevice,
) -> None:
    device.closes = True
    device.words[0:301:50] = range(100, 107)
    link = link_to(device.port, FAR_APART)
    for _ in range(3):
        scan = await link.scan()
        assert scan.failures == ()
        assert [scan[f"T{i}"].value for i in range(7)] == list(range(100, 107))
    assert link.state is LinkState.GOOD
    # Each on its own connection; a request that met the closing was sent once more, not oftener.
    assert device.connections == 21
    assert len(device.requests) == 21
    await link.close()


async def test_a_device_that_closes_without_an_answer_is_asked_once(device: FakeDevice) -> None:
    device.tamper = lambda _: b""
    link = link_to(device.port, FAR_APART)
    scan = await link.scan()
    assert not scan.answered
    assert len(device.requests) == 1
    await link.close()


async def test_a_connection_that_is_closed_before_it_is_open_is_no_silent_device(
    device: FakeDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    device.accepts = False
    make = Wire.init_setup_connect_listen

    def make_slow(wire: Wire, host: str, port: int) -> None:
        make(wire, host, port)
        connect: Any = wire.call_create

        async def connect_slowly() -> Any:
            made = await connect()
            # An access list closes what it has accepted; here always before the link goes on.
            while wire.transport is not None:
                await asyncio.sleep(0)
            return made

        wire.call_create = connect_slowly

    monkeypatch.setattr(Wire, "init_setup_connect_listen", make_slow)
    link = link_to(device.port, FAR_APART)
    scan = await link.scan()
    assert "the other side closed the connection at once" in str(scan.failures[0])
    assert link.requests == 0
    await link.close()


async def test_a_write_that_meets_a_closed_connection_is_not_sent_again(
    device: FakeDevice,
) -> None:
    link = link_to(device.port, FAR_APART)
    await link.scan()
    device.tamper = lambda _: b""
    with pytest.raises(Exception, match="closed after the last answer"):
        await link.write_registers(0, [1, 2])
    assert [function for function, _, _ in device.writes] == [16]
    await link.close()


@pytest.mark.parametrize("code", [1, 2, 3, 4])
async def test_a_burst_of_exceptions_costs_seconds_not_a_minute(
    device: FakeDevice, code: int
) -> None:
    clock = VirtualClock()
    link = link_to(device.port, FAR_APART, clock)
    assert (await link.scan())["T0"].good
    device.exception = code
    assert {reading.quality for reading in (await link.scan()).readings.values()} == {
        Quality.QUARANTINED
    }
    for second in range(1, 30):
        clock.advance_to(float(second))
        await link.scan()
    device.exception = None
    clock.advance_to(32.0)
    scan = await link.scan()
    assert all(reading.good for reading in scan.readings.values())
    assert link.state is LinkState.GOOD
    await link.close()


async def test_a_register_that_does_not_exist_is_asked_for_ever_more_rarely(
    device: FakeDevice,
) -> None:
    clock = VirtualClock()
    device.illegal = {100}
    link = link_to(device.port, FAR_APART, clock)
    asked = []
    for second in range(400):
        clock.advance_to(float(second))
        device.requests.clear()
        scan = await link.scan()
        assert scan["T1"].good
        if any(address == 100 for _, address, _ in device.requests):
            asked.append(second)
    pauses = [later - earlier for earlier, later in pairwise(asked)]
    assert pauses[:5] == [2, 4, 8, 16, 32]
    assert set(pauses[5:]) == {60}
    await link.close()


@pytest.mark.parametrize("hole", [None, 11], ids=["whole", "beside a bad register"])
async def test_what_was_refused_together_for_a_moment_is_read_together_again(
    device: FakeDevice, hole: int | None
) -> None:
    """Else the OP and PV of a loop would be of two moments for good."""
    clock = VirtualClock()
    block = [Tag(f"T{i}", Table.HOLDING, 10 + i, DataType.UINT16) for i in range(6)]
    link = link_to(device.port, block, clock)
    device.illegal = set() if hole is None else {hole}
    together = (3, 10, 6) if hole is None else (3, 12, 4)

    def refuse_together(frame: bytes) -> bytes:
        if device.requests[-1][2] < 4:
            return frame
        return frame[:4] + b"\0\3" + frame[6:7] + b"\x83\4"

    device.tamper = refuse_together
    await link.scan()
    device.requests.clear()
    await link.scan()
    assert together not in device.requests
    # It goes on refusing for a while, and is asked less and less often.
    for _ in range(60):
        clock.advance_to(clock.monotonic() + 1.0)
        await link.scan()
    assert 4 <= sum(count >= 4 for _, _, count in device.requests) <= 8
    device.tamper = None
    clock.advance_to(clock.monotonic() + 60.0)
    await link.scan()
    device.requests.clear()
    await link.scan()
    assert device.requests == [together] if hole is None else together in device.requests
    await link.close()


async def test_of_a_refused_request_each_tag_has_its_turn(device: FakeDevice) -> None:
    """A first tag that is really bad does not hide that the others are back."""
    clock = VirtualClock()
    block = [Tag(f"T{i}", Table.HOLDING, 10 + i, DataType.UINT16) for i in range(4)]
    link = link_to(device.port, block, clock)
    device.exception = 4
    await link.scan()
    device.exception, device.illegal = None, {10}
    clock.advance_to(2.0)
    await link.scan()
    clock.advance_to(4.0)
    scan = await link.scan()
    assert [name for name, reading in scan.readings.items() if reading.good] == ["T1", "T2", "T3"]
    await link.close()


async def test_a_serial_setting_that_the_port_refuses_is_a_failure_of_that_device(
    serial_line: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    termios = pytest.importorskip("termios")

    def refuse(*_: object) -> None:
        raise termios.error(22, "Invalid argument")

    # Some kernels refuse a parity on a pseudo-terminal, others ignore it.
    monkeypatch.setattr(termios, "tcsetattr", refuse)
    device = Device(link="modbus-rtu", serial_port=serial_line[0], register_map=Path("m.csv"))
    link = ModbusLink(ModbusSettings("plc", device), plan_reads(FAR_APART), SystemClock())
    scan = await link.scan()
    assert link.state is LinkState.DEMOTED
    said = str(scan.failures[0])
    assert "the serial port refuses its settings (Invalid argument)" in said
    assert "; correct baud rate, parity, data bits and stop bits" in said
    assert "parity" in said
    assert "cable" not in said
    await link.close()


async def test_a_port_that_fails_once_it_is_open_is_let_go(
    serial_line: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else it stays locked, for other programs and for the next attempt."""
    termios, fcntl = pytest.importorskip("termios"), pytest.importorskip("fcntl")
    read, looks = termios.tcgetattr, iter([True])

    def fail_after_the_first(port: int) -> Any:
        if not next(looks, False):
            raise termios.error(5, "Input/output error")
        return read(port)

    monkeypatch.setattr(termios, "tcgetattr", fail_after_the_first)
    device = Device(
        link="modbus-rtu", serial_port=serial_line[0], parity="none", register_map=Path("m.csv")
    )
    link = ModbusLink(ModbusSettings("plc", device), plan_reads(FAR_APART), SystemClock())
    scan = await link.scan()
    assert ": Input/output error; check serial_port" in str(scan.failures[0])
    port = os.open(serial_line[0], os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(port, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(port)
    await link.close()


@dataclass
class ClosingRtu(LoopbackServer):
    """RTU frames over TCP: holding register n holds n, and a connection is closed after an answer.

    With ``waits`` it is closed only when the next request is on its way, as over a slow network:
    that request is lost.
    """

    waits: bool = False
    served: int = 0

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        frame = await reader.readexactly(8)
        unit, function, address, count = struct.unpack(">BBHH", frame[:6])
        answer = frame[:6]
        if function != 8:
            words = range(address, address + count)
            answer = struct.pack(f">BBB{count}H", unit, function, 2 * count, *words)
        self.served += 1
        writer.write(answer + crc(answer))
        await writer.drain()
        if self.waits:
            # Ends also when the client closes.
            await reader.read(8)


@pytest.mark.parametrize("waits", [False, True], ids=["at once", "when asked again"])
async def test_a_gateway_that_closes_after_each_answer_starves_no_loop(waits: bool) -> None:
    gateway = ClosingRtu(waits=waits)
    await gateway.start()
    link = link_to(gateway.port, FAR_APART, kind="modbus-rtu-tcp")
    for _ in range(3):
        scan = await link.scan()
        assert scan.failures == ()
        assert [scan[f"T{i}"].value for i in range(7)] == [50 * i for i in range(7)]
    assert link.state is LinkState.GOOD
    # 21 requests, each answered once; one probe or none, before what closes was known to close.
    assert 21 <= gateway.served <= 22
    await link.close()
    await gateway.stop()


@dataclass
class NoisyRtu(LoopbackServer):
    """Sends the same bytes after each request."""

    reply: bytes = b""

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while await reader.readexactly(8):
            writer.write(self.reply)


@pytest.mark.parametrize(
    ("reply", "is_noise"),
    [
        (b"\xfc\x80\x00\xf8", True),
        (bytes([1, 3, 2, 0, 7, 0, 0]), True),
        (bytes([1, 3, 2, 0]), True),
        (b"", False),
        (bytes([2, 3, 2, 0, 7]) + crc(bytes([2, 3, 2, 0, 7])), False),
    ],
    ids=["wrong baud rate", "wrong CRC", "half a frame", "silence", "another unit"],
)
async def test_noise_on_a_line_is_not_called_silence(reply: bytes, is_noise: bool) -> None:
    server = NoisyRtu(reply=reply)
    await server.start()
    link = link_to(
        server.port, FAR_APART[:1], kind="modbus-rtu-tcp", timeout=1.0 if is_noise else 0.1
    )
    said = str((await link.scan()).failures[0])
    assert "did not answer within" in said
    assert ("bytes came that are no whole reply; check the line's baud rate" in said) is is_noise
    assert ("check the unit id" in said) is not is_noise
    await link.close()
    await server.stop()
