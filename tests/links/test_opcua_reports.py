"""A value that an OPC UA server reports late, by its own time stamps, is a late sample."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
import pytest_asyncio
from asyncua import Server, ua

from fieldlink.links import Quality, SystemClock, open_link
from fieldlink.site import Site
from tests.upward.mosquitto import free_port


class StampingServer:
    """A server whose time stamps are told: its clock is an hour ahead of ours."""

    def __init__(self) -> None:
        self.port = free_port()
        self._server = Server()
        self._nodes: dict[str, Any] = {}

    async def start(self) -> None:
        await self._server.init()
        self._server.set_force_server_timestamp(False)
        self._server.set_endpoint(f"opc.tcp://127.0.0.1:{self.port}")
        for name in ("L0.OP", "L0.PV"):
            node = ua.NodeId(name, 1)
            self._nodes[name] = await self._server.nodes.objects.add_variable(node, name, 0.0)
        await self._server.start()

    async def stop(self) -> None:
        await self._server.stop()

    async def write(self, value: float, *, age: float = 0.0, stamp: datetime | None = None) -> None:
        """Set PV, as taken ``age`` seconds ago or at ``stamp``."""
        stamp = stamp or datetime.now(UTC) + timedelta(hours=1.0) - timedelta(seconds=age)
        data = ua.DataValue(ua.Variant(value, ua.VariantType.Double), ServerTimestamp=stamp)
        await self._nodes["L0.PV"].write_value(data)


@pytest_asyncio.fixture
async def server() -> AsyncIterator[StampingServer]:
    running = StampingServer()
    await running.start()
    yield running
    await running.stop()


@pytest.mark.asyncio
@pytest.mark.parametrize(
    "stamp", [datetime(2026, 1, 1, tzinfo=UTC), datetime(1601, 1, 1, tzinfo=UTC)]
)
async def test_a_clock_that_stands_still_makes_no_value_late(
    server: StampingServer, make_opcua_site: Callable[..., Site], stamp: datetime
) -> None:
    site = make_opcua_site(server.port, opcua='mode = "subscribe"', loops=1)
    link = open_link(site, "plc", SystemClock())
    try:
        for step in range(1, 9):
            await server.write(float(step), stamp=stamp)
            await asyncio.sleep(0.3)
            assert (await link.scan())["L0.PV"].quality is Quality.GOOD
    finally:
        await link.close()


@pytest.mark.asyncio
async def test_a_value_of_a_second_ago_is_late_until_the_server_is_heard_again(
    server: StampingServer, make_opcua_site: Callable[..., Site]
) -> None:
    site = make_opcua_site(server.port, opcua='mode = "subscribe"', loops=1)
    link = open_link(site, "plc", SystemClock())
    seen: list[tuple[float, Quality]] = []

    async def look(seconds: float) -> list[tuple[float, Quality]]:
        del seen[:]
        for _ in range(round(seconds / 0.05)):
            reading = (await link.scan())["L0.PV"]
            if not seen or seen[-1][1] is not reading.quality:
                seen.append((reading.value, reading.quality))
            await asyncio.sleep(0.05)
        return list(seen)

    try:
        for step in range(1, 5):
            await server.write(float(step))
            usual = await look(0.7)
            # an hour between the clocks is no delay, nor is a value that changes now and then
            assert {quality for _, quality in usual} == {Quality.GOOD}
        await look(1.5)
        await server.write(50.0, age=1.2)
        qualities = [quality for _, quality in await look(2.5)]
        # the sign of life after it says that nothing has changed since
        assert qualities == [Quality.GOOD, Quality.LATE, Quality.GOOD]
        assert (await link.scan())["L0.PV"].value == 50.0
        await server.write(6.0)
        assert {quality for _, quality in await look(0.7)} == {Quality.GOOD}
    finally:
        await link.close()
