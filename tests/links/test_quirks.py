"""Workarounds for single devices, and tags that are read at rates of their own."""

from __future__ import annotations

import asyncio
import struct
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from fieldlink.links import (
    ExceptionReplyError,
    LinkState,
    LinkTimeoutError,
    Quality,
    SystemClock,
    VirtualClock,
)
from fieldlink.links.backoff import BackoffSettings
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.links.plan_reader import PlanReader
from fieldlink.registers import DataType, Table, Tag, pack_payload, plan_reads
from fieldlink.site import Device, Quirks
from tests.links.patience import PATIENCE, SHORT, expecting_silence

if TYPE_CHECKING:
    from tests.links.fake_device import FakeDevice

SOON = BackoffSettings(first=0.005, cap=0.02)


def word(address: int, **rest: Any) -> Tag:
    return Tag(f"R{address}", Table.HOLDING, address, DataType.UINT16, **rest)


def link_to(
    device: FakeDevice, tags: list[Tag], timeout: float = PATIENCE, **quirks: Any
) -> ModbusLink:
    settings = Device(
        link="modbus-tcp",
        host="127.0.0.1",
        port=device.port,
        timeout=timeout,
        register_map=Path("map.csv"),
        quirks=Quirks(**quirks),
    )
    plan = plan_reads(tags, one_tag=settings.quirks.one_request_per_tag)
    return ModbusLink(ModbusSettings("plc", settings, backoff=SOON), plan, SystemClock())


async def test_the_connection_is_closed_after_every_scan(device: FakeDevice) -> None:
    link = link_to(device, [word(1), word(300)], close_after_scan=True)
    for scans in range(1, 4):
        assert (await link.scan())["R1"].good
        assert device.connections == scans
    await link.close()


async def test_pauses_are_kept(device: FakeDevice) -> None:
    moments: list[float] = []

    def note(frame: bytes) -> bytes:
        moments.append(time.monotonic())
        return frame

    device.tamper = note
    link = link_to(
        device, [word(1), word(300)], pause_after_connect=0.1, pause_between_requests=0.05
    )
    began = time.monotonic()
    assert not (await link.scan()).failures
    await link.close()
    assert moments[0] - began >= 0.1
    assert moments[1] - moments[0] >= 0.05


async def test_one_request_a_tag(device: FakeDevice) -> None:
    link = link_to(device, [word(1), word(2)], one_request_per_tag=True)
    assert not (await link.scan()).failures
    assert device.requests == [(3, 1, 1), (3, 2, 1)]
    await link.close()


async def test_a_probe_after_a_time_out_where_it_is_asked_for(device: FakeDevice) -> None:
    link = link_to(device, [word(1)], probe_after_timeout=True)
    device.mute = True
    with expecting_silence(link):
        assert isinstance((await link.scan()).failures[0], LinkTimeoutError)
    device.mute = False
    device.exception = 6
    await asyncio.sleep(SOON.cap)
    # The exception answers the echo's function, and so proves that nothing older will come.
    assert isinstance((await link.scan()).failures[0], ExceptionReplyError)
    assert [function for function, _, _ in device.requests] == [3, 8, 3]
    device.exception = None
    assert (await link.scan())["R1"].good
    await link.close()


class CountingReader:
    """Counts the reads of each address; a set of addresses that do not answer."""

    def __init__(self) -> None:
        self.reads: dict[int, int] = {}
        self.mute = False

    async def read(self, table: Table, address: int, count: int) -> bytes:
        self.reads[address] = self.reads.get(address, 0) + 1
        if self.mute:
            raise LinkTimeoutError("plc", "no answer", "wait")
        return pack_payload(table, list(range(address, address + count)))


async def test_tags_at_a_rate_of_their_own_keep_their_value_and_its_time() -> None:
    clock, device = VirtualClock(), CountingReader()
    plan = plan_reads([word(1), word(200, every=10.0)])
    reader = PlanReader(plan, device.read, clock)
    ages = []
    for second in range(31):
        clock.advance_to(float(second))
        scan = await reader.scan()
        assert scan["R1"].age(clock.monotonic()) == 0.0
        assert scan["R200"].value == 200.0
        ages.append(scan["R200"].age(clock.monotonic()))
    assert device.reads[1] == 31
    assert device.reads[200] == pytest.approx(4, abs=1)
    assert max(ages) < 10.0
    assert ages[5] == 5.0


async def test_a_kept_value_does_not_outlive_two_intervals() -> None:
    clock, device = VirtualClock(), CountingReader()
    reader = PlanReader(plan_reads([word(1), word(200, every=10.0)]), device.read, clock)
    await reader.scan()
    device.mute = True
    clock.advance_to(5.0)
    scan = await reader.scan()
    assert scan["R1"].quality is Quality.NOT_READ
    assert scan["R200"].good
    assert not scan.answered
    assert reader.state is LinkState.DEMOTED
    clock.advance_to(21.0)
    assert (await reader.scan())["R200"].quality is Quality.NOT_READ


class LateUdp(asyncio.DatagramProtocol):
    """Register n holds n; answers after the delays given, then at once."""

    def __init__(self, delays: list[float]) -> None:
        self._delays = delays

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport: Any = transport

    def datagram_received(self, data: bytes, addr: Any) -> None:
        transaction, _, _, unit, function, address, count = struct.unpack(">HHHBBHH", data)
        words = struct.pack(f">{count}H", *range(address, address + count))
        head = struct.pack(">HHHBBB", transaction, 0, 3 + len(words), unit, function, len(words))
        delay = self._delays.pop(0) if self._delays else 0.0
        asyncio.get_running_loop().call_later(delay, self._transport.sendto, head + words, addr)


async def listening(answers: LateUdp, patience: float) -> tuple[asyncio.BaseTransport, Device]:
    """Bind a device that answers so; return its socket and what the site file says of it."""
    transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
        lambda: answers, local_addr=("127.0.0.1", 0)
    )
    device = Device(
        link="modbus-udp",
        host="127.0.0.1",
        port=transport.get_extra_info("sockname")[1],
        timeout=patience,
        register_map=Path("map.csv"),
    )
    return transport, device


async def test_a_late_datagram_is_passed_over() -> None:
    transport, device = await listening(LateUdp([3.0 * SHORT]), SHORT)
    link = ModbusLink(
        ModbusSettings("plc", device, backoff=SOON),
        plan_reads([word(10), word(200)]),
        SystemClock(),
    )
    assert isinstance((await link.scan()).failures[0], LinkTimeoutError)
    for _ in range(200):
        scan = await link.scan()
        for tag, value in (("R10", 10.0), ("R200", 200.0)):
            assert scan[tag].value == value or not scan[tag].good
        if not scan.failures:
            break
        await asyncio.sleep(0.01)
    assert not scan.failures
    await link.close()
    # Also after the end, for the daemon's last words.
    assert link.connects == 1
    transport.close()


class NoisyUdp(LateUdp):
    """Sends datagrams that are no frames before its replies."""

    def datagram_received(self, data: bytes, addr: Any) -> None:
        for noise in (b"\x07" * 12, data[:5], b""):
            self._transport.sendto(noise, addr)
        super().datagram_received(data, addr)


async def test_a_datagram_that_is_no_frame_is_passed_over() -> None:
    transport, device = await listening(NoisyUdp([]), PATIENCE)
    link = ModbusLink(ModbusSettings("plc", device), plan_reads([word(10)]), SystemClock())
    scan = await link.scan()
    assert not scan.failures
    assert scan["R10"].value == 10.0
    await link.close()
    transport.close()
