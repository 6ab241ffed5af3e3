"""No value of before counts as good: not one that a server reports late, nor one that it keeps."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
import pytest_asyncio
from asyncua import Server, ua

from fieldlink.links import Quality, SystemClock, VirtualClock, open_link
from fieldlink.links.opcua import OpcuaLink
from fieldlink.links.opcua_reports import SHARE, Reports
from fieldlink.links.opcua_session import OpcuaSession
from fieldlink.links.opcua_values import NodeValue
from fieldlink.site import Site
from tests.links.opcua_server import OpcuaServer
from tests.seeds import in_suite
from tests.upward.mosquitto import free_port


class StampingServer:
    """A server whose time stamps are told: its clock is an hour ahead of ours."""

    _made: Server | None = None
    """One for all tests: its standard nodes take a second and a half of a processor."""

    def __init__(self) -> None:
        self.port = free_port()
        self._nodes: dict[str, Any] = {}

    async def start(self) -> None:
        if StampingServer._made is None:
            StampingServer._made = Server()
            await StampingServer._made.init()
            StampingServer._made.set_force_server_timestamp(False)
        self._server = StampingServer._made
        self._server.set_endpoint(f"opc.tcp://127.0.0.1:{self.port}")
        for name in ("L0.OP", "L0.PV"):
            node = ua.NodeId(name, 1)
            self._nodes[name] = await self._server.nodes.objects.add_variable(node, name, 0.0)
        await self._server.start()

    async def stop(self) -> None:
        await self._server.delete_nodes(list(self._nodes.values()))
        await self._server.stop()

    async def load_again(self, value: float) -> None:
        """Replace PV's node, as loading a project does; this server does not tell subscribers."""
        node = ua.NodeId("L0.PV", 1)
        await self._server.delete_nodes([self._nodes["L0.PV"]])
        added = await self._server.nodes.objects.add_variable(node, "L0.PV", value)
        self._nodes["L0.PV"] = added

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
    site = make_opcua_site(server.port, opcua='mode = "subscribe"', loops=1, period=0.8)
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


@pytest.mark.asyncio
# asyncua's server forgets a coroutine of its own where a watched node is deleted.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:coroutine .* was never awaited:RuntimeWarning")
async def test_a_node_that_is_reported_no_more_is_found_and_subscribed_again(
    server: StampingServer,
    make_opcua_site: Callable[..., Site],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("fieldlink.links.opcua_looks.LOOK_AGAIN", 0.1)
    site = make_opcua_site(server.port, opcua='mode = "subscribe"', loops=1)
    link = OpcuaLink.of_site(site, "plc", SystemClock())
    try:
        for step in range(1, 9):
            await server.write(float(step))
            await asyncio.sleep(0.3)
            assert (await link.scan())["L0.PV"].value == float(step)
        # Nothing was doubted as long as values only changed.
        assert link.connects == 1
        await server.load_again(42.0)
        until = time.monotonic() + 60.0
        while (scan := await link.scan())["L0.PV"].value != 42.0:
            assert time.monotonic() < until
            await asyncio.sleep(0.1)
        assert scan["L0.PV"].good
        assert link.connects == 2
    finally:
        await link.close()


class OtherwiseRead(OpcuaSession):
    """A session without a server: reports 5 once, and reads as ``reads``."""

    reads = 5.25

    async def open(self) -> None:
        """There is none."""

    async def _begin_reports(self, nodes: Sequence[str], milliseconds: float) -> None:
        assert milliseconds > 0.0
        for handle, node in enumerate(nodes):
            self._reports.expect(handle, node)
            self._reports.take(message(0.0, 5.0, handle=handle), self._clock.monotonic())

    async def read(self, nodes: Sequence[str]) -> list[NodeValue]:
        return [NodeValue(self.reads, "Good", good=True, refused=False) for _ in nodes]

    async def check_reports(self, until: float) -> None:
        """The server is heard."""

    async def close(self) -> None:
        """Nothing is open."""


@pytest.mark.asyncio
async def test_a_difference_that_no_new_session_cures_opens_ever_fewer(
    make_opcua_site: Callable[..., Site], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A server with a dead band of its own reports less than it lets read."""
    monkeypatch.setattr("fieldlink.links.opcua.OpcuaSession", OtherwiseRead)
    site = make_opcua_site(4840, opcua='mode = "subscribe"', loops=1)
    clock = VirtualClock()
    link = OpcuaLink.of_site(site, "plc", clock)

    async def scan_for(seconds: float) -> tuple[int, int]:
        before, told, end = link.connects, 0, clock.monotonic() + seconds
        while clock.monotonic() < end:
            told += len((await link.scan()).failures)
            clock.advance_to(clock.monotonic() + 1.0)
        return link.connects - before, told

    assert await scan_for(4.5 * 3600.0) == (1 + 9 + 3, 1)
    # An hour passes between two looks, until one finds nothing.
    monkeypatch.setattr(OtherwiseRead, "reads", 5.0)
    assert await scan_for(3700.0) == (0, 0)
    monkeypatch.setattr(OtherwiseRead, "reads", 6.0)
    assert await scan_for(20.0) == (1, 1)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def foreign() -> AsyncIterator[OpcuaServer]:
    running = OpcuaServer(few_nodes=True, loops=1)
    await running.start()
    yield running
    await running.kill()


@pytest.mark.asyncio(loop_scope="module")
async def test_a_server_that_stands_still_is_believed_for_three_quarters_of_a_period(
    foreign: OpcuaServer, make_opcua_site: Callable[..., Site]
) -> None:
    period = 2.0
    site = make_opcua_site(foreign.port, opcua='mode = "subscribe"', loops=1, period=period)
    link = open_link(site, "plc", SystemClock())
    good: list[float] = []
    try:
        await foreign.tell(step=7)
        while (await link.scan())["L0.OP"].value != 7.0:
            await asyncio.sleep(0.02)
        # a new value has just been reported: the server stops as soon as it may
        foreign.pause()
        paused = time.monotonic()
        while True:
            scan = await link.scan()
            if scan["L0.OP"].quality is Quality.GOOD:
                good.append(scan.monotonic)
            elif scan.monotonic > paused + period:
                break
            await asyncio.sleep(0.02)
    finally:
        foreign.resume()
        await link.close()
    assert max(good, default=paused) - paused < 3.0 * SHARE * period


@pytest.mark.asyncio(loop_scope="module")
@pytest.mark.parametrize("period", in_suite(1, [1.0, 4.0]))
async def test_a_server_is_asked_until_it_shows_life_four_times_a_period(
    foreign: OpcuaServer, make_opcua_site: Callable[..., Site], period: float
) -> None:
    """node-opcua makes a sign of life every second round of what is asked for as every round."""
    site = make_opcua_site(foreign.port, opcua='mode = "subscribe"', loops=1, period=period)
    link = open_link(site, "plc", SystemClock())
    assert isinstance(link, OpcuaLink)
    try:
        await link.scan()
        assert link._session is not None
        reports = link._session._reports
        assert (reports.sampling, reports.publishing) == (SHARE * period, SHARE * period)
        assert reports.limit == 3.0 * SHARE * period
    finally:
        await link.close()


@pytest.mark.asyncio(loop_scope="module")
@pytest.mark.parametrize("mode", in_suite(1, ["subscribe", "read"]))
async def test_a_scan_tells_that_it_had_to_connect(
    foreign: OpcuaServer, make_opcua_site: Callable[..., Site], mode: str
) -> None:
    site = make_opcua_site(foreign.port, opcua=f'mode = "{mode}"', loops=1)
    link = open_link(site, "plc", SystemClock())
    try:
        assert [(await link.scan()).connected for _ in range(3)] == [True, False, False]
    finally:
        await link.close()


def message(
    sent: float | None,
    value: float | None = None,
    *,
    stamp: float = 0.0,
    more: bool = False,
    handle: int = 0,
) -> ua.PublishResult:
    """A server's message of second ``sent`` of its clock; without a value a sign of life."""
    result = ua.PublishResult(MoreNotifications=more)
    origin = datetime(2026, 1, 1, tzinfo=UTC)
    result.NotificationMessage.PublishTime = (
        datetime(1601, 1, 1, tzinfo=UTC) if sent is None else origin + timedelta(seconds=sent)
    )
    if value is not None:
        data = ua.DataValue(ua.Variant(value), ServerTimestamp=origin + timedelta(seconds=stamp))
        item = ua.MonitoredItemNotification(ClientHandle=handle, Value=data)
        result.NotificationMessage.NotificationData = [ua.DataChangeNotification([item])]
    return result


def begin_reports(until: float = 10.0) -> Reports:
    """Reports at 4 s, with a message a second up to second ``until``; the first has a value."""
    reports = Reports(4.0)
    reports.expect(0, "PV")
    reports.take(message(0.0, 5.0), 0.0)
    for second in range(1, round(until) + 1):
        reports.take(message(float(second)), float(second))
    return reports


def test_values_are_as_old_as_the_last_message_and_a_sample() -> None:
    reports = begin_reports()
    assert reports.latest("PV") is not None
    assert (reports.age(10.0), reports.age(12.0), reports.limit) == (1.0, 3.0, 3.0)


def test_a_message_that_was_long_under_way_makes_nothing_newer() -> None:
    reports = begin_reports()
    reports.take(message(11.0), 14.0)
    assert reports.age(14.0) == 4.0
    # the server's clock is a day ahead or behind: only what is later than usual counts
    for ahead in (-86400.0, 86400.0):
        other = Reports(4.0)
        for second in range(10):
            other.take(message(second + ahead), float(second))
        assert other.age(9.0) == 1.0


def test_after_a_pause_of_the_server_the_second_message_counts() -> None:
    """The first may hold what was sampled before the pause, with a stamp of after it."""
    reports = begin_reports()
    reports.take(message(15.0), 15.0)
    assert reports.age(15.0) == 6.0
    reports.take(message(16.0), 16.0)
    assert reports.age(16.0) == 1.0


def test_messages_that_come_in_a_burst_are_no_pause_of_the_server() -> None:
    reports = begin_reports()
    for second in (11.0, 12.0, 13.0, 14.0):
        reports.take(message(second), 14.0)
    assert reports.age(14.0) == 1.0


def test_a_server_without_a_clock_is_timed_by_ours() -> None:
    reports = Reports(4.0)
    for second in range(5):
        reports.take(message(None), float(second))
    assert reports.age(4.0) == 1.0
    reports.take(message(None), 9.0)
    assert reports.age(9.0) == 6.0
    reports.take(message(None), 10.0)
    assert reports.age(10.0) == 1.0


def test_the_first_part_of_a_report_makes_nothing_newer() -> None:
    reports = begin_reports()
    reports.take(message(11.0, 6.0, stamp=11.0, more=True), 11.0)
    assert reports.age(11.0) == 2.0
    reports.take(message(11.0), 11.0)
    assert reports.age(11.0) == 1.0


def test_longer_intervals_of_the_server_make_older_values_good() -> None:
    reports = Reports(1.0)
    reports.grant_publishing(
        ua.CreateSubscriptionResult(RevisedPublishingInterval=500.0, RevisedMaxKeepAliveCount=3)
    )
    reports.grant_sampling(1000.0)
    reports.grant_sampling(100.0)
    assert (reports.publishing, reports.sampling, reports.limit) == (1.5, 1.0, 2.75)


def test_a_subscription_that_ends_tells_its_status() -> None:
    reports = begin_reports()
    result = message(11.0)
    status = ua.StatusCode(ua.StatusCodes.BadTimeout)
    result.NotificationMessage.NotificationData = [ua.StatusChangeNotification(status)]
    reports.take(result, 11.0)
    assert (reports.ended, reports.age(11.0)) == ("BadTimeout", 2.0)
