"""The Modbus TCP link against a device that misbehaves in the ways devices do."""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from fieldlink.links import (
    AccessRefusedError,
    ExceptionReplyError,
    LinkState,
    LinkTimeoutError,
    LinkUnreachableError,
    Quality,
    ReplyMismatchError,
    SystemClock,
)
from fieldlink.links.backoff import BackoffSettings
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.registers import DataType, Table, Tag, plan_reads
from fieldlink.site import Device, Quirks
from tests.links.patience import PATIENCE, expecting_silence, until

if TYPE_CHECKING:
    from tests.links.fake_device import FakeDevice

QUIRKS = Quirks()
SOON = BackoffSettings(first=0.01, cap=0.05)


def words_tag(name: str, address: int, **rest: Any) -> Tag:
    return Tag(name, Table.HOLDING, address, DataType.UINT16, **rest)


FOUR = [words_tag(f"T{i}", 10 + i) for i in range(4)]


@asynccontextmanager
async def link_to(
    device: FakeDevice,
    tags: Sequence[Tag] = FOUR,
    max_gap: int = 8,
    quirks: Quirks = QUIRKS,
    patience: float = PATIENCE,
    **settings: Any,
) -> AsyncIterator[ModbusLink]:
    link = ModbusLink(
        ModbusSettings(
            "plc",
            Device(
                link="modbus-tcp",
                host="127.0.0.1",
                port=device.port,
                timeout=patience,
                register_map=Path("map.csv"),
                quirks=quirks,
            ),
            **{"backoff": SOON} | settings,
        ),
        plan_reads(tags, max_gap),
        SystemClock(),
    )
    await link.open()
    try:
        yield link
    finally:
        await link.close()


async def scan_until_good(link: ModbusLink, tries: int = 100) -> None:
    for _ in range(tries):
        scan = await link.scan()
        if not scan.failures:
            return
        await asyncio.sleep(0.02)
    pytest.fail(f"the link did not recover: {scan.failures}")


async def test_every_table_is_read_and_scaled(device: FakeDevice) -> None:
    device.words[0:2] = [0x41C8, 0x0000]
    device.words[5] = 250
    device.bits[3] = 1
    tags = [
        Tag("float", Table.HOLDING, 0, DataType.FLOAT32),
        Tag("scaled", Table.INPUT, 5, DataType.INT16, scale=0.1, offset=-5.0),
        Tag("coil", Table.COIL, 3, DataType.BOOL),
        Tag("contact", Table.DISCRETE, 4, DataType.BOOL),
    ]
    async with link_to(device, tags) as link:
        scan = await link.scan()
    assert {name: reading.value for name, reading in scan.readings.items()} == {
        "float": 25.0,
        "scaled": 20.0,
        "coil": 1.0,
        "contact": 0.0,
    }
    assert scan.requests == 4
    assert not scan.failures
    assert [function for function, _, _ in device.requests] == [3, 4, 1, 2]


async def test_neighbours_share_a_request_and_a_time_stamp(device: FakeDevice) -> None:
    async with link_to(device) as link:
        scan = await link.scan()
    assert device.requests == [(3, 10, 4)]
    assert len({reading.monotonic for reading in scan.readings.values()}) == 1
    assert link.state is LinkState.GOOD


@pytest.mark.parametrize(
    ("word", "quality"), [(99, Quality.ABOVE_RANGE), (0, Quality.BELOW_RANGE), (50, Quality.GOOD)]
)
async def test_a_value_outside_its_range_is_not_good(
    device: FakeDevice, word: int, quality: Quality
) -> None:
    device.words[10] = word
    async with link_to(device, [words_tag("T", 10, low=1.0, high=98.0)]) as link:
        reading = (await link.scan())["T"]
    assert reading.quality is quality
    assert math.isnan(reading.value) != reading.good


async def test_nan_in_a_register_is_not_good(device: FakeDevice) -> None:
    device.words[0:2] = struct.unpack(">2H", struct.pack(">f", math.nan))
    async with link_to(device, [Tag("T", Table.HOLDING, 0, DataType.FLOAT32)]) as link:
        assert (await link.scan())["T"].quality is Quality.NOT_A_NUMBER


async def test_an_unknown_tag_says_so(device: FakeDevice) -> None:
    async with link_to(device) as link:
        assert (await link.scan())["NOWHERE"].quality is Quality.UNKNOWN_TAG


async def test_a_device_absent_at_the_start_is_found_when_it_comes(
    new_device: Callable[..., FakeDevice],
) -> None:
    device = new_device()
    await device.start()
    await device.stop()
    async with link_to(device) as link:
        scan = await link.scan()
        assert [type(failure) for failure in scan.failures] == [LinkUnreachableError]
        assert f"127.0.0.1:{device.port}" in str(scan.failures[0])
        assert all(r.quality is Quality.NOT_READ for r in scan.readings.values())
        assert link.state is LinkState.DEMOTED
        await device.start()
        await scan_until_good(link)
        assert link.state is LinkState.GOOD


async def test_a_device_that_goes_away_comes_back(device: FakeDevice) -> None:
    async with link_to(device) as link:
        await scan_until_good(link)
        await device.stop()
        assert not (await link.scan()).answered
        await device.start()
        await scan_until_good(link)


async def test_while_waiting_to_retry_a_scan_sends_nothing(device: FakeDevice) -> None:
    device.mute = True
    slow = BackoffSettings(first=60.0, cap=60.0)
    async with link_to(device, backoff=slow) as link:
        with expecting_silence(link):
            first = await link.scan()
        second = await link.scan()
    assert isinstance(first.failures[0], LinkTimeoutError)
    assert isinstance(second.failures[0], LinkUnreachableError)
    assert "next attempt in" in str(second.failures[0])
    assert str(second.failures[0]).count(f"127.0.0.1:{device.port}") == 1
    assert len(device.requests) == 1


async def test_a_lost_connection_is_noticed_before_the_time_out(device: FakeDevice) -> None:
    device.tamper = lambda _frame: b""
    async with link_to(device) as link:
        scan = await link.scan()
    assert isinstance(scan.failures[0], LinkUnreachableError)
    assert "connection was dropped" in str(scan.failures[0])


async def test_a_late_reply_is_never_another_requests_value(device: FakeDevice) -> None:
    far_apart = [words_tag("first", 10), words_tag("second", 200)]
    device.words[10], device.words[200] = 111, 222
    async with link_to(device, far_apart) as link:
        await scan_until_good(link)
        for _ in range(5):
            device.gate.clear()
            with expecting_silence(link):
                late = await link.scan()
            assert isinstance(late.failures[0], LinkTimeoutError)
            device.gate.set()
            await asyncio.sleep(SOON.cap)
            scan = await link.scan()
            for tag, value in (("first", 111.0), ("second", 222.0)):
                if scan[tag].good:
                    assert scan[tag].value == value
        await scan_until_good(link)


@pytest.mark.parametrize("transaction", [0, 7777])
async def test_a_wrong_transaction_id_is_refused(device: FakeDevice, transaction: int) -> None:
    device.tamper = lambda frame: struct.pack(">H", transaction) + frame[2:]
    async with link_to(device) as link:
        with expecting_silence(link):
            scan = await link.scan()
        assert isinstance(scan.failures[0], ReplyMismatchError | LinkTimeoutError)
        assert not scan.answered
        device.tamper = None
        await scan_until_good(link)


async def test_a_reply_of_the_wrong_length_is_refused(device: FakeDevice) -> None:
    device.tamper = lambda frame: (
        frame[:4] + struct.pack(">HBBB", 5, frame[6], frame[7], 2) + frame[9:11]
    )
    async with link_to(device) as link:
        scan = await link.scan()
        assert isinstance(scan.failures[0], ReplyMismatchError)
        assert not scan.answered


async def test_an_answer_that_is_cut_short_tells_how_many_registers_to_ask_for(
    device: FakeDevice,
) -> None:
    def cut(frame: bytes) -> bytes:
        return frame[:4] + struct.pack(">HBBB", 7, frame[6], frame[7], 4) + frame[9:13]

    device.tamper = cut
    async with link_to(device) as link:
        said = str((await link.scan()).failures[0])
        assert "reading holding 10 to 13 got 2 of 4 registers; set max_registers = 2" in said
        # Not so where longer answers were whole.
        device.tamper = None
        await scan_until_good(link)
        device.tamper = cut
        assert "max_registers" not in str((await link.scan()).failures[0])


async def test_silence_to_long_requests_alone_tells_how_long_they_may_be(
    device: FakeDevice,
) -> None:
    tags = [words_tag("SHORT", 0), *(words_tag(f"T{i}", 100 + i) for i in range(4))]
    device.longest = 1
    async with link_to(device, tags, patience=0.2) as link:
        failure = (await link.scan()).failures[0]
    said = "lower max_registers: it has answered up to 1 registers, and never 4"
    assert said in str(failure)
    device.mute = True
    async with link_to(device, FOUR, patience=0.05) as link:
        failure = (await link.scan()).failures[0]
    assert "if it answers shorter requests, lower max_registers" in str(failure)


async def test_a_part_of_a_reply_is_not_called_silence(device: FakeDevice) -> None:
    device.tamper = lambda frame: frame[:9]
    # long enough for the part to come in on a busy machine: the whole of it is waited for
    async with link_to(device, patience=5.0) as link:
        scan = await link.scan()
        assert isinstance(scan.failures[0], LinkTimeoutError)
        assert "only a part of a reply came; raise the device's timeout" in str(scan.failures[0])
        device.tamper = None
        await scan_until_good(link)


async def test_a_bad_register_is_found_and_costs_the_others_nothing(device: FakeDevice) -> None:
    tags = [words_tag(f"T{i}", 10 + i) for i in range(8)]
    device.words[10:18] = range(100, 108)
    device.illegal = {13}
    async with link_to(device, tags) as link:
        found = await link.scan()
        assert found["T3"].quality is Quality.QUARANTINED
        assert isinstance(found.failures[0], ExceptionReplyError)
        expected = {f"T{i}": 100.0 + i for i in range(8) if i != 3}
        assert {n: r.value for n, r in found.readings.items() if r.good} == expected
        assert link.state is LinkState.DEGRADED

        device.requests.clear()
        again = await link.scan()
        assert {n: r.value for n, r in again.readings.items() if r.good} == expected
        assert not again.failures
        assert device.requests == [(3, 10, 3), (3, 14, 4)]


async def test_a_hole_that_was_read_along_splits_the_block(device: FakeDevice) -> None:
    device.illegal = {12}
    async with link_to(device, [words_tag("left", 11), words_tag("right", 13)]) as link:
        assert all(reading.good for reading in (await link.scan()).readings.values())
        device.requests.clear()
        await link.scan()
        assert device.requests == [(3, 11, 1), (3, 13, 1)]


async def test_a_quarantined_register_is_taken_back_when_it_answers(device: FakeDevice) -> None:
    device.illegal = {12}
    async with link_to(device, quarantine=0.0) as link:
        await link.scan()
        assert (await link.scan())["T2"].quality is Quality.QUARANTINED
        device.illegal = set()
        assert (await link.scan())["T2"].good
        assert device.requests[-1] == (3, 10, 4)


async def test_busy_is_no_reason_to_quarantine(device: FakeDevice) -> None:
    device.exception = 6
    async with link_to(device) as link:
        scan = await link.scan()
        assert {reading.quality for reading in scan.readings.values()} == {Quality.NOT_READ}
        assert "poll it less often" in str(scan.failures[0])
        device.exception = None
        assert (await link.scan())["T0"].good


async def test_one_request_that_times_out_does_not_starve_the_rest(device: FakeDevice) -> None:
    tags = [words_tag("slow", 10), words_tag("quick", 200)]

    def only_quick(frame: bytes) -> bytes:
        return frame if device.requests[-1][1] == 200 else struct.pack(">H", 0) + frame[2:]

    device.tamper = only_quick
    async with link_to(device, tags) as link:
        good = False
        for _ in range(200):
            # Of the slow one nothing is accepted; whichever of the two has its turn first.
            with expecting_silence(link):
                good = (await link.scan())["quick"].good
            if good:
                break
            await asyncio.sleep(0.02)
        assert good


async def test_writes_need_a_declared_range(device: FakeDevice) -> None:
    async with link_to(device, writable=((100, 110),)) as link:
        await link.write_registers(100, [1, 2, 3])
        await link.write_register(110, 9)
        assert await link.read_registers(100, 11) == [1, 2, 3, *[0] * 7, 9]
        for address, words in ((99, [1, 2]), (110, [1, 2]), (100, [])):
            with pytest.raises(AccessRefusedError):
                await link.write_registers(address, words)
        with pytest.raises(AccessRefusedError, match="allowed: 100 to 110"):
            await link.write_register(111, 1)
    assert device.writes == [(16, 100, [1, 2, 3]), (6, 110, [9])]


async def test_a_write_without_a_reply_is_not_repeated(device: FakeDevice) -> None:
    device.mute = True
    async with link_to(device, writable=((100, 110),)) as link:
        with expecting_silence(link), pytest.raises(LinkTimeoutError):
            await link.write_registers(100, [5])
    assert device.writes == [(16, 100, [5])]


@pytest.mark.parametrize(
    ("code", "advice"),
    [(1, "does not know this function"), (2, "cannot be written"), (3, "so many registers")],
)
async def test_a_refused_write_is_explained_as_one(
    device: FakeDevice, code: int, advice: str
) -> None:
    device.exception = code
    async with link_to(device, writable=((100, 110),)) as link:
        with pytest.raises(ExceptionReplyError, match=advice):
            await link.write_registers(100, [5])
        with pytest.raises(ExceptionReplyError, match=r"the map|max_registers"):
            await link.read_registers(100, 1)


async def test_a_write_overtakes_waiting_reads(device: FakeDevice) -> None:
    device.gate.clear()
    async with link_to(device, writable=((100, 100),)) as link:
        reads = [asyncio.create_task(link.read_registers(i, 1)) for i in range(4)]
        await until(lambda: len(device.requests) == 1)
        write = asyncio.create_task(link.write_register(100, 1))
        await asyncio.sleep(0)
        device.gate.set()
        await asyncio.gather(write, *reads)
    assert [function for function, _, _ in device.requests] == [3, 6, 3, 3, 3]


async def test_a_cancelled_request_leaves_a_usable_link(device: FakeDevice) -> None:
    device.gate.clear()
    async with link_to(device) as link:
        task = asyncio.create_task(link.scan())
        await until(lambda: len(device.requests) == 1)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        device.gate.set()
        await scan_until_good(link)


def answering_as(unit: int | None, transaction: int | None) -> Callable[[bytes], bytes]:
    """Return what puts another unit or transaction id into every answer."""

    def tamper(frame: bytes) -> bytes:
        number, protocol, length, own = struct.unpack(">HHHB", frame[:7])
        number = number if transaction is None else transaction
        own = own if unit is None else unit
        return struct.pack(">HHHB", number, protocol, length, own) + frame[7:]

    return tamper


@pytest.mark.parametrize(
    ("unit", "transaction", "remedy"),
    [
        (255, None, "set unit = 255"),
        (None, 0, "transaction id 0 is in its answer"),
    ],
)
async def test_a_habit_of_a_device_is_told_with_what_to_set(
    device: FakeDevice, unit: int | None, transaction: int | None, remedy: str
) -> None:
    device.tamper = answering_as(unit, transaction)
    async with link_to(device) as link:
        failure = (await link.scan()).failures[0]
        assert remedy in str(failure)


async def test_a_misfit_among_answers_that_fit_is_no_habit(device: FakeDevice) -> None:
    async with link_to(device) as link:
        await scan_until_good(link)
        device.tamper = answering_as(2, None)
        failure = (await link.scan()).failures[0]
        assert "look for a second master or a faulty gateway" in str(failure)
        assert "set unit" not in str(failure)
