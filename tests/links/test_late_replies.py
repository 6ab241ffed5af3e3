"""Without a transaction id a late reply must never become another register's value."""

from __future__ import annotations

import asyncio
import random
from collections.abc import AsyncIterator, Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusIOException
from pymodbus.framer import FramerType

from fieldlink.links import LinkTimeoutError, SystemClock
from fieldlink.links.backoff import BackoffSettings
from fieldlink.links.frames import echo_request, read_request, write_one_request
from fieldlink.links.late_replies import LateReplies
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.registers import DataType, Table, Tag, plan_reads
from fieldlink.site import Device
from tests.links.patience import PATIENCE, SHORT, expecting_silence, until
from tests.links.slow_rtu import SlowRtu

TIMEOUT = 0.08
LONGEST_PAUSE = 0.02
APART = [10, 110, 210, 310]
TAGS = [Tag(f"R{n}", Table.HOLDING, n, DataType.UINT16) for n in APART]


@pytest.fixture
async def new_slow() -> AsyncIterator[Callable[..., Any]]:
    made: list[SlowRtu] = []

    async def make(**settings: Any) -> SlowRtu:
        device = SlowRtu(**settings)
        await device.start()
        made.append(device)
        return device

    yield make
    for device in made:
        await device.stop()


def link_to(
    slow: SlowRtu, timeout: float = TIMEOUT, tags: Sequence[Tag] = tuple(TAGS)
) -> ModbusLink:
    device = Device(
        link="modbus-rtu-tcp",
        host="127.0.0.1",
        port=slow.port,
        timeout=timeout,
        register_map=Path("map.csv"),
    )
    soon = BackoffSettings(first=0.005, cap=LONGEST_PAUSE)
    return ModbusLink(ModbusSettings("plc", device, backoff=soon), plan_reads(tags), SystemClock())


async def scan_until_good(link: ModbusLink, tries: int = 400) -> None:
    for _ in range(tries):
        scan = await link.scan()
        if not scan.failures:
            assert {name: r.value for name, r in scan.readings.items()} == {
                f"R{n}": float(n) for n in APART
            }
            return
        await asyncio.sleep(0.01)
    pytest.fail(f"the link did not recover: {scan.failures}")


async def test_the_danger_is_real_a_bare_client_takes_a_late_reply(
    new_slow: Callable[..., Any],
) -> None:
    slow = await new_slow()
    slow.gate.clear()
    first, second = (
        AsyncModbusTcpClient(
            "127.0.0.1", port=slow.port, framer=FramerType.RTU, timeout=timeout, retries=0
        )
        for timeout in (SHORT, PATIENCE)
    )
    await first.connect()
    with pytest.raises(ModbusIOException):
        await first.read_holding_registers(10, count=1)
    first.close()
    await second.connect()
    asked = asyncio.create_task(second.read_holding_registers(110, count=1))
    await until(lambda: len(slow.requests) == 2)
    slow.gate.set()
    reply = await asked
    second.close()
    assert reply.registers == [10]


@pytest.mark.parametrize("echoes", ["answered", "refused", "ignored"])
async def test_a_late_reply_is_never_another_registers_value(
    new_slow: Callable[..., Any], echoes: str
) -> None:
    rng = random.Random(1)
    slow = await new_slow(
        delay=lambda: rng.choice([0.0, 0.0, 0.0, 0.3, 1.6, 2.5]) * TIMEOUT, echoes=echoes
    )
    link = link_to(slow)
    failed = 0
    for _ in range(24):
        scan = await link.scan()
        failed += any(isinstance(failure, LinkTimeoutError) for failure in scan.failures)
        for n in APART:
            reading = scan[f"R{n}"]
            assert reading.value == n or not reading.good
        await asyncio.sleep(0.01)
    assert failed > 3
    slow.delay = lambda: 0.0
    await scan_until_good(link)
    await link.close()


async def test_a_cancelled_requests_reply_is_no_other_requests_value(
    new_slow: Callable[..., Any],
) -> None:
    slow = await new_slow()
    slow.gate.clear()
    link = link_to(slow, PATIENCE)
    for number, n in enumerate(APART, start=1):
        task = asyncio.create_task(link.read_registers(n, 1))
        await until(lambda number=number: len(slow.requests) == number)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
    slow.gate.set()
    await scan_until_good(link)
    assert link.late_replies > 0
    await link.close()


async def test_late_replies_are_counted(new_slow: Callable[..., Any]) -> None:
    slow = await new_slow()
    slow.gate.clear()
    link = link_to(slow, PATIENCE)
    with expecting_silence(link):
        assert isinstance((await link.scan()).failures[0], LinkTimeoutError)
    scans = asyncio.create_task(scan_until_good(link))
    # The late reply comes into the connection after, when that has sent its probe.
    await until(lambda: len(slow.requests) == 2)
    slow.gate.set()
    await scans
    assert link.late_replies == 1
    await link.close()


async def test_a_device_that_says_nothing_to_fc8_and_refuses_other_lengths_comes_back(
    new_slow: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fieldlink.links.late_replies.FORGET_AFTER", 0.5)
    neighbours = {n + k for n in APART for k in (1, 2, 3, 4, 5, 6, 7, 8)}
    delays = iter([1.6 * TIMEOUT])
    slow = await new_slow(delay=lambda: next(delays, 0.0), echoes="ignored", illegal=neighbours)
    link = link_to(slow)
    assert isinstance((await link.scan()).failures[0], LinkTimeoutError)
    await scan_until_good(link)
    await link.close()


async def test_the_late_refusal_of_an_echo_does_not_settle_what_came_after_it(
    new_slow: Callable[..., Any],
) -> None:
    slow = await new_slow(echoes="refused", delay=lambda: 0.02)
    slow.gate.clear()
    # The read that is the second probe, of the five registers, has the length of the four others.
    numbers = [*range(10, 15), *range(110, 114)]
    tags = [Tag(f"R{n}", Table.HOLDING, n, DataType.UINT16) for n in numbers]
    link = link_to(slow, PATIENCE, tags)
    for _ in range(3):
        with expecting_silence(link):
            assert isinstance((await link.scan()).failures[0], LinkTimeoutError)
        await asyncio.sleep(LONGEST_PAUSE)
    scan = asyncio.create_task(link.scan())
    await until(lambda: len(slow.requests) == 4)
    slow.gate.set()
    for _ in range(400):
        found = await scan
        for n in numbers:
            reading = found[f"R{n}"]
            assert reading.value == n or not reading.good
        if not found.failures:
            break
        await asyncio.sleep(0.01)
        scan = asyncio.create_task(link.scan())
    assert not found.failures
    await link.close()


def test_an_exception_proves_something_for_an_echo_alone() -> None:
    late = LateReplies()
    assert late.proves(echo_request(1), bytes((0x88, 1)))
    assert not late.proves(read_request(Table.HOLDING, 0, 2), bytes((0x83, 2)))
    assert late.proves(read_request(Table.HOLDING, 0, 2), bytes((3, 4, 0, 1, 0, 2)))
    late.owe(echo_request(1), 0.0)
    assert late.proves(echo_request(2), echo_request(2).pdu)
    assert not late.proves(echo_request(2), bytes((0x88, 1)))
    assert late.recognise(bytes((0x88, 1)))
    assert late.proves(echo_request(2), bytes((0x88, 1)))


def test_a_probe_never_looks_like_what_is_owed() -> None:
    late = LateReplies()
    wanted = read_request(Table.HOLDING, 100, 4)
    late.owe(wanted, 0.0)
    late.owe(write_one_request(7, 9), 0.0)
    for _ in range(12):
        probe = late.probe_for(wanted)
        late.owe(probe, 0.0)
        answer = probe.head + bytes(probe.size - len(probe.head))
        assert probe.is_regular(answer)
        assert not wanted.is_regular(answer)
    assert late.recognise(wanted.head + bytes(8))
    assert late.recognise(write_one_request(7, 9).pdu)
    assert not late.recognise(bytes((0x83, 2)))


def test_what_is_owed_is_forgotten_after_a_while() -> None:
    late = LateReplies()
    late.owe(read_request(Table.HOLDING, 0, 1), now=0.0)
    late.forget(59.0)
    assert late
    late.forget(61.0)
    assert not late
