"""The OPC UA link: a device's tags as nodes of a server, and an array to write blocks to.

Every scan reads the nodes of each request at one time (``mode = "read"``), or takes what the server
has reported (``mode = "subscribe"``). A value is good only with a good status, and only while the
server is heard; what it said before it fell silent is never taken for new. Reported values are good
for three quarters of a period (`opcua_reports`). Readings carry the times of this machine, so that
they compare with those of other links; the server's clock may be wrong, so its time stamps tell
only which reports come later than usual.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence

from fieldlink.links.backoff import Backoff, BackoffSettings, describe_next
from fieldlink.links.base import LinkState, Quality, Reading, Scan
from fieldlink.links.clock import Clock
from fieldlink.links.errors import AccessRefusedError, LinkError, LinkPausedError
from fieldlink.links.opcua_looks import Looks
from fieldlink.links.opcua_reports import SHARE
from fieldlink.links.opcua_session import OpcuaSession, StatusError
from fieldlink.links.opcua_values import NodeValue
from fieldlink.links.writable import Ranges, find_writable
from fieldlink.registers import ReadRequest, Tag
from fieldlink.site import Site

__all__ = ["OpcuaLink"]


class OpcuaLink:
    """A `Link` with `RegisterAccess` to one OPC UA server.

    Args:
        site: the site.
        name: of the device.
        plan: its Read requests.
        clock: stamps the readings and times the pauses.
        writable: elements (first, last) of the exchange array that may be written.
        beat: seconds between two scans, which time slower requests.
    """

    def __init__(
        self,
        site: Site,
        name: str,
        plan: Sequence[ReadRequest],
        clock: Clock,
        *,
        writable: Ranges = (),
        beat: float = 0.0,
    ) -> None:
        self._site, self._name, self._clock = site, name, clock
        self._device = device = site.devices[name]
        self._plan = tuple(plan)
        self._writable = writable
        self._beat = beat
        first = min(0.1, device.retry_after_max)
        self._backoff = Backoff(BackoffSettings(first=first, cap=device.retry_after_max))
        self._session: OpcuaSession | None = None
        self._opening = asyncio.Lock()
        self._looks = Looks()
        self._last_error = "not tried yet"
        self._began_first: float | None = None
        self._served: dict[int, int] = {}
        self._refused: tuple[str, ...] = ()
        self.state = LinkState.CLOSED
        self.connects = 0
        self.late_replies = 0

    @classmethod
    def of_site(cls, site: Site, device: str, clock: Clock) -> OpcuaLink:
        """Build the link of a device of the site file.

        Writable are the elements that Fieldlink has in the exchange areas of loops whose
        write-back is enabled, and nothing else.
        """
        return cls(
            site,
            device,
            site.requests(device),
            clock,
            writable=find_writable(site, device),
            beat=site.poll_period(device),
        )

    @property
    def quarantined(self) -> tuple[str, ...]:
        """The tags whose nodes the server does not let us read."""
        return self._refused

    async def open(self) -> None:
        """Nothing to prepare: the first scan connects, and an absent server is tried again."""

    async def scan(self) -> Scan:
        """Read every node that is due once."""
        began, began_utc = self._clock.monotonic(), self._clock.utc()
        readings: dict[str, Reading] = {}
        failures: list[LinkError] = []
        refused: list[str] = []
        requests, connects = 0, self.connects
        beat = self._beat_at(began)
        for number, request in enumerate(self._plan):
            quality = Quality.NOT_READ
            if not self._is_due(number, request, beat):
                quality = Quality.NOT_DUE
            elif not failures or isinstance(failures[-1], StatusError):
                try:
                    values = await self._values(request, began)
                except LinkError as error:
                    failures.append(error)
                    await self._drop(error)
                else:
                    requests += self._device.opcua.mode == "read"
                    self._served[number] = beat // max(1, request.polls)
                    self._judge(request, values, readings, failures, refused)
                    continue
            for tag in request.tags:
                readings[tag.name] = Reading(math.nan, quality, began, began_utc)
        if self._session is not None and self._device.opcua.mode == "subscribe":
            try:
                await self._session.look_again()
            except LinkError as error:
                failures.append(error)
                await self._drop(error)
        connected = self.connects > connects
        scan = Scan(readings, began, began_utc, requests, tuple(failures), connected)
        self._refused = tuple(refused)
        self.state = self._state_after(scan)
        return scan

    async def close(self) -> None:
        """End the session."""
        session, self._session = self._session, None
        if session is not None:
            await session.close()

    async def read_registers(self, address: int, count: int) -> list[int]:
        """Read elements of the exchange array."""
        session, node = await self._exchange()
        try:
            return await session.read_words(node, address, count)
        except LinkError as error:
            await self._drop(error)
            raise

    async def write_registers(self, address: int, words: Sequence[int]) -> None:
        """Write elements of the exchange array in one request.

        Raises:
            AccessRefusedError: an element is outside the writable ranges.
            LinkError: the server did not confirm; after a `LinkTimeoutError` the write may have
                been carried out.
        """
        self._guard(address, len(words))
        session, node = await self._exchange()
        try:
            await session.write_words(node, address, words)
        except LinkError as error:
            await self._drop(error)
            raise

    async def write_register(self, address: int, word: int) -> None:
        """Write one element; errors as `write_registers`."""
        await self.write_registers(address, [word])

    async def _exchange(self) -> tuple[OpcuaSession, str]:
        node = self._device.opcua.exchange_node
        if node is None:
            raise AccessRefusedError(
                self._name, "there is no array for exchange areas", "name one as exchange_node"
            )
        return await self._opened(), node

    def _guard(self, address: int, count: int) -> None:
        last = address + count - 1
        if not any(first <= address and last <= end for first, end in self._writable):
            allowed = ", ".join(f"{first} to {end}" for first, end in self._writable)
            raise AccessRefusedError(
                self._name,
                f"writing elements {address} to {last} is not allowed by the site file",
                f"allowed: {allowed or 'nothing (write-back is off)'}",
            )

    async def _values(self, request: ReadRequest, began: float) -> list[NodeValue | None]:
        session = await self._opened()
        if self._device.opcua.mode == "read":
            return list(await session.read([tag.node for tag in request.tags]))
        until = began + min(SHARE * self._period, self._device.timeout)
        await session.check_reports(until)
        if session.unwatched and not self._looks.note_new_session():
            # Told the first time, and no cure: not to be told, nor to cost a sample, again.
            session = await self._opened_anew(session)
            await session.check_reports(until)
        session.check_watched()
        return [session.latest(tag.node) for tag in request.tags]

    async def _opened(self) -> OpcuaSession:
        """Return the session; open one where there is none and the pause after a failure is over.

        Raises:
            LinkError: there is none.
        """
        async with self._opening:
            return self._session or await self._open_session()

    async def _opened_anew(self, old: OpcuaSession) -> OpcuaSession:
        """Return a new session in place of one that works."""
        if self._session is old:
            self._session = None
            await old.close()
        return await self._opened()

    async def _open_session(self) -> OpcuaSession:
        wait = self._backoff.remaining(self._clock.monotonic())
        if wait > 0.0:
            where, what = self._device.where, self._last_error
            raise LinkPausedError(
                self._name,
                what if where in what else f"{where}: {what}",
                describe_next(wait, self._backoff.failures),
            )
        session = self._session = OpcuaSession(
            self._name, self._device, self._site, self._clock, self._looks
        )
        try:
            await session.open()
            if self._device.opcua.mode == "subscribe":
                nodes = dict.fromkeys(tag.node for request in self._plan for tag in request.tags)
                await session.subscribe(list(nodes), self._period)
        except LinkError as error:
            # The next one who asks must not find a session that is not open.
            await self._drop(error)
            raise
        self.connects += 1
        self._backoff.succeeded()
        return session

    async def _drop(self, error: LinkError) -> None:
        """Close a session that has failed; a refusal of one node does not end it."""
        if isinstance(error, StatusError | AccessRefusedError):
            return
        session, self._session = self._session, None
        if session is None:
            return
        self._last_error = error.what
        self._backoff.failed(self._clock.monotonic())
        await session.close()

    def _judge(
        self,
        request: ReadRequest,
        values: Sequence[NodeValue | None],
        readings: dict[str, Reading],
        failures: list[LinkError],
        refused: list[str],
    ) -> None:
        now, utc = self._clock.monotonic(), self._clock.utc()
        for tag, found in zip(request.tags, values, strict=True):
            value, quality = _reading(tag, found)
            status = "" if found is None or found.good else found.status
            readings[tag.name] = Reading(value, quality, now, utc, status=status)
            if quality is Quality.QUARANTINED and found is not None:
                if not refused:
                    failures.append(
                        StatusError(
                            self._name,
                            f"{tag.name} ({tag.node}) cannot be read: status {found.status}",
                            "check the node map and the rights of our user",
                        )
                    )
                refused.append(tag.name)

    def _state_after(self, scan: Scan) -> LinkState:
        if not any(reading.quality is not Quality.NOT_DUE for reading in scan.readings.values()):
            return self.state
        if not scan.answered:
            return LinkState.DEMOTED
        return LinkState.DEGRADED if scan.failures else LinkState.GOOD

    @property
    def _period(self) -> float:
        """Seconds of our clock between two scans."""
        return self._beat / self._device.speed if self._beat else 1.0

    def _beat_at(self, now: float) -> int:
        if self._began_first is None:
            self._began_first = now
        return (
            round((now - self._began_first) * self._device.speed / self._beat) if self._beat else 0
        )

    def _is_due(self, number: int, request: ReadRequest, beat: int) -> bool:
        if request.polls <= 1 or not self._beat:
            return True
        return self._served.get(number) != beat // request.polls


def _reading(tag: Tag, found: NodeValue | None) -> tuple[float, Quality]:
    """Return the engineering value of what a server gave, and what it is worth."""
    if found is None:
        return math.nan, Quality.NOT_READ
    if found.refused:
        return math.nan, Quality.QUARANTINED
    if found.late:
        return math.nan, Quality.LATE
    if not found.good:
        return math.nan, Quality.BAD_STATUS
    if not isinstance(found.value, bool | int | float):
        return math.nan, Quality.NO_SCALAR
    raw = float(found.value)
    if not math.isfinite(raw):
        return math.nan, Quality.NOT_A_NUMBER
    judged = tag.judge(raw)
    if not judged.quality.is_good:
        return math.nan, Quality[judged.quality.name]
    return judged.value, Quality.GOOD
