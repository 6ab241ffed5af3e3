"""Everything that is published: takes the daemon's records, spools them, runs each format.

publishing = Publishing(site, health=..., actions=..., tell=...)
publishing.put(record)                # at once, from the event loop; never waits
async with publishing.running():      # spool and connections
    ...
"""

from __future__ import annotations

import asyncio
import sqlite3
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from functools import partial
from importlib import metadata
from importlib.util import find_spec

from fieldlink.errors import FieldlinkError, MissingExtraError
from fieldlink.once_a_minute import OnceAMinute
from fieldlink.site import Site
from fieldlink.store import Record
from fieldlink.upward.broker_settings import BrokerSettings
from fieldlink.upward.commands import Action, CommandDesk
from fieldlink.upward.counts import UpwardReport
from fieldlink.upward.delivery import Delivery
from fieldlink.upward.errors import UpwardError
from fieldlink.upward.formats import Format, Health
from fieldlink.upward.json_format import JsonFormat
from fieldlink.upward.messages import Message, message_maker
from fieldlink.upward.spool import Spool
from fieldlink.upward.spool_thread import SpoolThread

__all__ = ["Publishing"]

SPOOL = "mqtt_spool.sqlite"

LINGER = 0.1
"""Seconds for which messages are gathered before they go to disk together."""

MEMORY = 20_000
"""Messages held while the disk cannot be written; then the oldest go. A few megabytes."""

MOST_AT_ONCE = 500
"""Messages in one transaction: some milliseconds of the spool's thread and of the event loop."""

TRIM_EVERY = 10.0
"""Seconds between two applications of the spool's bounds."""

TRY_DISK_EVERY = 5.0
"""Seconds until a spool that could not be written is tried again."""

_NEEDS = {"json": ("paho",), "sparkplug": ("paho", "google.protobuf")}


class Publishing:
    """The way upward of a site.

    Args:
        site: the site; must have a table ``[mqtt]``.
        health: gives the site's health.
        actions: carry out the commands from above, by name.
        tell: records events: kind, source, message, ``bad``.
        defect: records an unforeseen error: source, error, consequence.

    Raises:
        MissingExtraError: a package is not installed.
        UpwardError: the spool cannot be used.
    """

    def __init__(
        self,
        site: Site,
        *,
        health: Callable[[], Health],
        actions: Mapping[str, Action],
        tell: Callable[..., None],
        defect: Callable[[str, Exception, str], object],
    ) -> None:
        mqtt = site.file.mqtt
        assert mqtt is not None
        _demand_packages(site, mqtt.formats)
        self._site, self._health, self._tell, self._defect = site, health, tell, defect
        self._make = message_maker(mqtt.publish)
        desk = CommandDesk(mqtt.commands, actions, tell)
        self._formats: list[Format] = []
        if "json" in mqtt.formats:
            self._formats.append(JsonFormat(site, desk))
        if "sparkplug" in mqtt.formats:
            from fieldlink.upward.sparkplug_format import SparkplugFormat

            self._formats.append(SparkplugFormat(site, desk, metadata.version("fieldlink")))
        self._spool = Spool(
            site.data_dir / SPOOL,
            [form.name for form in self._formats],
            most_bytes=round(1e6 * mqtt.spool.megabytes),
            longest=3600.0 * mqtt.spool.hours,
        )
        self._waiting: deque[Message] = deque()
        self._arrived = asyncio.Event()
        self._deliveries: list[Delivery] = []
        self._spooled = self._dropped = 0
        self._failing = False
        self._stream = ""
        self._retained: list[str] | None = None
        self._drops = OnceAMinute()

    def put(self, record: Record) -> None:
        """Take a record; returns at once."""
        message = self._make(record)
        if message is None:
            return
        if len(self._waiting) >= MEMORY:
            self._waiting.popleft()
            self._note_dropped(1, "memory is full while the spool cannot be written")
        self._waiting.append(message)
        self._arrived.set()

    def follow(self, site: Site) -> None:
        """Take over a changed site file: its loops and their names, but not its table [mqtt]."""
        # The table takes effect at the next start, like the other tables about the daemon.
        file = site.file.model_copy(update={"mqtt": self._site.file.mqtt})
        self._site = Site(site.path, file, site.maps)
        self._tell_formats()

    def report(self) -> UpwardReport:
        """Return the counts."""
        names = [form.name for form in self._formats]
        reports = [delivery.report() for delivery in self._deliveries]
        return UpwardReport(
            formats=dict(zip(names, reports, strict=False)),
            spooled=self._spooled,
            dropped=self._dropped,
            failing=self._failing,
        )

    @asynccontextmanager
    async def running(self) -> AsyncIterator[list[asyncio.Task[None]]]:
        """Spool and deliver while the block runs; yields tasks that must not end by themselves.

        A spool that cannot be opened is tried again: the plant's samples matter more.
        """
        thread = SpoolThread(self._spool)
        try:
            try:
                await thread.call(lambda spool: spool.open())
            except UpwardError as error:
                self._note_failing(error)
            self._tell_formats()
            self._deliveries = [
                Delivery(
                    form,
                    BrokerSettings.without_files(self._site, form.name),
                    partial(BrokerSettings.of_site, self._site, form.name),
                    thread,
                    self._health,
                    self._tell,
                    self._defect,
                )
                for form in self._formats
            ]
            spooling = asyncio.create_task(self._keep_spooling(thread), name="mqtt spool")
            tasks = [
                asyncio.create_task(delivery.run(), name=f"mqtt {form.name}")
                for form, delivery in zip(self._formats, self._deliveries, strict=True)
            ]
            try:
                yield [spooling, *tasks]
            finally:
                spooling.cancel()
                await asyncio.gather(spooling, return_exceptions=True)
                await self._spool_waiting(thread)
                for delivery in self._deliveries:
                    delivery.stop()
                await asyncio.gather(*tasks, return_exceptions=True)
        finally:
            await thread.close()

    def _tell_formats(self) -> None:
        self._stream = self._spool.stream
        for form in self._formats:
            form.follow(self._site, self._stream)
        self._retained = [topic for form in self._formats for topic in form.retained]
        self._arrived.set()
        for delivery in self._deliveries:
            delivery.wake(look=True)

    async def _keep_spooling(self, thread: SpoolThread) -> None:
        trim_at = time.monotonic()
        while True:
            await self._arrived.wait()
            await asyncio.sleep(LINGER)
            self._arrived.clear()
            try:
                written = await self._spool_waiting(thread)
                if written and time.monotonic() >= trim_at:
                    await self._trim(thread)
                    trim_at = time.monotonic() + TRIM_EVERY
            except Exception as error:  # noqa: BLE001  (told; the other parts go on)
                self._defect("mqtt spool", error, "these messages are left out")
                continue
            if not written:
                await asyncio.sleep(TRY_DISK_EVERY)
                self._arrived.set()

    async def _spool_waiting(self, thread: SpoolThread) -> bool:
        """Write what waits to disk; return whether that worked."""
        if not await self._spool_retained(thread):
            return False
        while self._waiting:
            count = min(len(self._waiting), MOST_AT_ONCE)
            batch = [self._waiting.popleft() for _ in range(count)]
            try:
                last = await thread.call(partial(_append, batch))
            except (sqlite3.Error, FieldlinkError) as error:
                self._waiting.extendleft(reversed(batch))
                self._note_failing(error)
                return False
            if self._failing:
                self._failing = False
                self._tell("mqtt.spool_written", "mqtt", "the spool is written again")
            self._note_stream()
            self._spooled += count
            self._note_spooled(batch, last - count + 1)
        return True

    async def _spool_retained(self, thread: SpoolThread) -> bool:
        """Have topics forgotten that the site has left; return whether that worked."""
        topics, self._retained = self._retained, None
        if topics is None:
            return True
        try:
            left = await thread.call(lambda spool: spool.retain(topics))
        except (sqlite3.Error, FieldlinkError) as error:
            self._retained = self._retained or topics
            self._note_failing(error)
            return False
        self._note_stream()
        if left:
            for delivery in self._deliveries:
                delivery.wake()
        return True

    def _note_stream(self) -> None:
        """Take over another file's numbering; tell where it took the place of a damaged one."""
        before = self._stream
        if before == self._spool.stream:
            return
        self._tell_formats()
        if before:
            self._tell(
                "mqtt.spool_replaced",
                "mqtt",
                "the spool was damaged and is set aside; what waited in it is not delivered",
                bad=True,
            )

    def _note_failing(self, error: Exception) -> None:
        if not self._failing:
            self._failing = True
            said = str(error) if isinstance(error, FieldlinkError) else f"{error}; check the disk"
            self._tell("mqtt.spool_failing", "mqtt", said, bad=True)

    def _note_spooled(self, batch: list[Message], first: int) -> None:
        for number, message in enumerate(batch, first):
            numbered = Message(message.kind, message.source, message.utc_ms, message.body, number)
            for form in self._formats:
                form.note(numbered)
        for delivery in self._deliveries:
            delivery.wake()

    async def _trim(self, thread: SpoolThread) -> None:
        try:
            dropped = await thread.call(lambda spool: spool.trim())
        except (sqlite3.Error, FieldlinkError) as error:
            self._tell("mqtt.spool_failing", "mqtt", f"{error}; check the disk", bad=True)
            return
        if dropped:
            self._note_dropped(dropped, "the spool's bound or age was reached")

    def _note_dropped(self, number: int, why: str) -> None:
        self._dropped += number
        if count := self._drops.note("dropped", number):
            self._tell(
                "mqtt.dropped",
                "mqtt",
                f"{count} messages were dropped undelivered: {why}; see mqtt.spool",
                bad=True,
            )


def _append(batch: list[Message], spool: Spool) -> int:
    return spool.append(batch)


def _demand_packages(site: Site, formats: tuple[str, ...]) -> None:
    wanted = {name for form in formats for name in _NEEDS[form]}
    missing = sorted(name for name in wanted if not _is_installed(name))
    if missing:
        raise MissingExtraError(f"{site.path}: the table [mqtt]", " and ".join(missing), "mqtt")


def _is_installed(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:
        return False
