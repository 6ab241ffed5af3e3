"""A device that does not answer its exchange area is still polled, and its other loops written."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from fieldlink.daemon.site_runner import SiteRunner
from fieldlink.daemon.writeback.area_looks import AreaLooks
from fieldlink.links import LinkError, LinkPausedError, LinkState, LinkTimeoutError, SystemClock
from fieldlink.store import EventRecord
from tests.daemon.live import site_for

WRITEBACK = """
[loops.LOOP.writeback]
enabled = true
loop_id = 101
base = 100
"""

SHORTEST_PAUSE = 0.001
TIMED_OUT = LinkTimeoutError("plc", "no answer", "look")


@asynccontextmanager
async def runner_on(device: Any, folder: Path) -> AsyncIterator[tuple[Any, list[Any]]]:
    """Run a device by hand: its polls and looks come when the test says so."""
    stored: list[Any] = []
    site = site_for(folder, {"plc": device.port}, WRITEBACK).with_device(
        "plc", retry_after_max=SHORTEST_PAUSE
    )
    site_runner = SiteRunner(site, SystemClock(), stored.append, live=False)
    await site_runner.open()
    try:
        yield site_runner.runners["plc"], stored
    finally:
        await site_runner.close()


def kinds(stored: list[Any]) -> list[str]:
    return [record.kind for record in stored if isinstance(record, EventRecord)]


async def test_an_area_that_costs_the_connection_is_looked_at_ever_more_seldom(
    device: Any, plc: Any, tmp_path: Path
) -> None:
    device.words[0:4] = struct.unpack(">4H", struct.pack(">2f", 50.0, 40.0))
    device.tamper = lambda frame: b"" if device.requests[-1][1] >= 100 else frame

    async with runner_on(device, tmp_path) as (runner, stored):

        async def run(seconds: range) -> None:
            for second in seconds:
                device.words[4] = second
                await asyncio.sleep(2.0 * SHORTEST_PAUSE)
                await runner.poll(float(second))
                assert runner.status().state is LinkState.GOOD
                await runner.service(float(second))

        await run(range(1, 601))
        looks = sum(address >= 100 for _, address, _ in device.requests)
        # A read that ends a connection is repeated once.
        assert looks <= 2 * 12
        assert kinds(stored).count("writeback.unreachable") == 1

        device.tamper = None
        await run(range(601, 701))
        assert "writeback.reachable" in kinds(stored)
        beats = [address for _, address, _ in device.writes]
        assert beats.count(106) > 5
        assert not any(kind.startswith("device.") for kind in kinds(stored)[1:])
    assert plc.words[100] == 1


async def test_a_device_that_is_away_is_not_told_of_each_of_its_areas(
    device: Any, tmp_path: Path
) -> None:
    """Of a PLC with fifty loops there were fifty events beside the one of the device."""
    device.tamper = lambda _: b""
    async with runner_on(device, tmp_path) as (runner, stored):
        for second in range(1, 20):
            await asyncio.sleep(2.0 * SHORTEST_PAUSE)
            await runner.poll(float(second))
            await runner.service(float(second))
        found = kinds(stored)
    assert "writeback.unreachable" not in found
    assert any(kind.startswith("device.") for kind in found)


def looks_of(areas: AreaLooks, until: float, end: Callable[[str], LinkError | None]) -> list[float]:
    """Let time pass to second ``until``; return when silent areas were looked at."""
    at = []
    now = 0.0
    while now < until:
        if (loop := areas.next_silent(now)) is not None:
            at.append(now)
            areas.note(loop, end(loop), now, answers=True)
        now += 1.0
    return at


def test_silent_areas_of_a_device_take_turns_and_cost_what_one_would() -> None:
    areas = AreaLooks(0.1)
    for loop in ("A", "B", "C"):
        areas.note(loop, TIMED_OUT, 0.0, answers=True)
    asked: list[str] = []

    def end(loop: str) -> LinkError:
        asked.append(loop)
        return TIMED_OUT

    assert looks_of(areas, 31.0, end) == [2.0, 6.0, 14.0, 22.0, 30.0]
    assert asked == ["A", "B", "C", "A", "B"]
    # One that answers lets the others be looked at without a pause.
    areas.note("C", None, 38.0, answers=True)
    assert not areas.is_silent("C")
    assert areas.next_silent(38.0) == "A"


def test_a_device_that_is_away_or_paused_is_no_silent_area() -> None:
    areas = AreaLooks(0.1)
    areas.note("A", TIMED_OUT, 0.0, answers=False)
    areas.note("A", LinkPausedError("plc", "no answer", "in 1 s"), 2.0, answers=True)
    assert not areas.is_silent("A")
    areas.note("A", TIMED_OUT, 4.0, answers=True)
    # While the device is away the area is looked at as often as ever.
    for now in (6.0, 8.0, 10.0):
        assert areas.next_silent(now) == "A"
        areas.note("A", TIMED_OUT, now, answers=False)


def test_a_look_that_takes_long_takes_a_small_share_of_the_time() -> None:
    at = looks_of(started(4.0), 1000.0, lambda _: TIMED_OUT)
    assert at[-1] - at[-2] == 80.0


def started(timeout: float) -> AreaLooks:
    areas = AreaLooks(timeout)
    areas.note("A", TIMED_OUT, 0.0, answers=True)
    return areas
