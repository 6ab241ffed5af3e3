"""Delivers the spool to the broker in one format, over one connection after another.

A message leaves the spool when the broker has it: for JSON by the acknowledgement of QoS 1, for
Sparkplug, whose messages go with QoS 0, by the answer to a subscription sent after them. What was
under way when a connection broke is sent again, with the same number. JSON goes over MQTT 5 where
the broker speaks it: with 3.1.1, brokers acknowledge what their access rules make them drop.
"""

from __future__ import annotations

import asyncio
import sqlite3
import time
from collections.abc import Callable, Iterable

from fieldlink.once_a_minute import OnceAMinute
from fieldlink.upward.broker import BrokerSession
from fieldlink.upward.broker_settings import BrokerSettings
from fieldlink.upward.connections import Connections
from fieldlink.upward.counts import FormatReport
from fieldlink.upward.errors import (
    BrokerError,
    BrokerRefusalError,
    BrokerVersionError,
    UpwardError,
)
from fieldlink.upward.formats import Format, Health
from fieldlink.upward.messages import Message
from fieldlink.upward.packets import MqttVersion, Outgoing, TooLarge
from fieldlink.upward.spool_thread import SpoolThread

__all__ = ["Delivery"]

BATCH = 50
"""Messages between two confirmations: some milliseconds of the event loop, which the sampling needs
too, and yet an hour of 100 loops (360,000 samples) is delivered in minutes."""

HEALTH_EVERY = 5.0
"""Seconds between two looks at the site's health."""

REFUSALS = 5
"""Connections in a row that end over the same single message before it is skipped."""

STOP_WITHIN = 3.0
"""Seconds for what still waits when the daemon stops; the rest is sent after the next start."""


class Delivery:
    """One format's way to the broker.

    Args:
        form: the format.
        settings: the broker, without what files hold.
        reread: gives them with what their files hold now: a password or certificate may be new, or
            no more of use, which is told as a connection that was not made.
        spool: the messages.
        health: gives the site's health.
        tell: records events: kind, source, message, ``bad``.
        defect: records an unforeseen error: source, error, consequence.
    """

    def __init__(
        self,
        form: Format,
        settings: BrokerSettings,
        reread: Callable[[], BrokerSettings],
        spool: SpoolThread,
        health: Callable[[], Health],
        tell: Callable[..., None],
        defect: Callable[[str, Exception, str], object],
    ) -> None:
        self._format = form
        self._reread = reread
        self._spool = spool
        self._health = health
        self._tell = tell
        self._defect = defect
        self._wake = asyncio.Event()
        self._stopping = False
        self._session: BrokerSession | None = None
        self._connections = Connections(settings, f"mqtt {form.name}", tell)
        self._version = MqttVersion.V5 if form.confirms else MqttVersion.V3_1_1
        self._unused_birth: int | None = None
        self._batch = BATCH
        self._refusals = 0
        self._delivered = self._skipped = self._waiting = 0
        self._look_at = 0.0
        self._large = OnceAMinute()

    def wake(self, *, look: bool = False) -> None:
        """Look for new messages now, and at the site's health where ``look`` says so."""
        if look:
            self._look_at = 0.0
        self._wake.set()

    def stop(self) -> None:
        """End soon: `run` returns when what waits is sent, at most `STOP_WITHIN` from now."""
        self._stopping = True
        self._wake.set()
        if self._session is not None and not self._connections.is_up:
            self._session.abort()

    def report(self) -> FormatReport:
        """Return the counts."""
        return FormatReport(
            connected=self._connections.is_up,
            connects=self._connections.count,
            delivered=self._delivered,
            waiting=self._waiting,
            skipped=self._skipped,
            last_error=self._connections.last_error,
        )

    async def run(self) -> None:
        """Deliver until stopped; while the broker does not answer, try again and again."""
        while not self._stopping:
            try:
                await self._connect_and_deliver()
            except BrokerVersionError as error:
                if self._version is MqttVersion.V5:
                    # Not told yet: the other version may do.
                    self._version = MqttVersion.V3_1_1
                    self._connections.note_failure()
                else:
                    self._version = MqttVersion.V5 if self._format.confirms else self._version
                    self._note_loss(str(error))
            except (BrokerError, UpwardError) as error:
                self._note_loss(str(error))
            except sqlite3.Error as error:
                self._note_loss(f"the spool cannot be used: {error}; check the disk")
            except Exception as error:  # noqa: BLE001  (told; the other parts go on)
                name = f"mqtt {self._format.name}"
                self._defect(name, error, "the connection is opened again")
                self._connections.note_failure()
            await self._pause()

    async def _pause(self) -> None:
        while not self._stopping:
            left = self._connections.pause
            if left <= 0.0:
                return
            self._wake.clear()
            try:
                async with asyncio.timeout(left):
                    await self._wake.wait()
            except TimeoutError:
                return
            await self._count_waiting()

    async def _connect_and_deliver(self) -> None:
        settings = await asyncio.to_thread(self._reread)
        number, self._unused_birth = self._unused_birth, None
        if number is None:
            name = self._format.name
            number = await self._spool.call(lambda spool: spool.next_birth(name))
        session = BrokerSession(settings, self._format.will(number), self._wake, self._version)
        self._session = session
        farewell: tuple[Outgoing, ...] = ()
        try:
            await session.open()
            if filters := self._format.subscriptions():
                await session.subscribe(filters)
            await self._begin(session)
            await self._repeat(session)
            self._connections.note_begin()
            await self._deliver(session)
            farewell = tuple(self._format.farewell())
        finally:
            # A message that the broker refuses is reported when it is skipped.
            self._connections.note_end(is_known=self._stopping or self._refusals > 0)
            self._session = None
            if not session.was_reached:
                # tck-id-topics-nbirth-bdseq-increment: one more for each CONNECT that was sent
                self._unused_birth = number
            await session.close(farewell)

    async def _begin(self, session: BrokerSession) -> None:
        """Send what a session begins with, and have it confirmed before any message is sent.

        A message must not be blamed for births that the broker does not take.
        """
        try:
            await self._send(session, self._format.begin(self._health()))
        except BrokerRefusalError as error:
            if self._format.confirms:
                raise
            raise BrokerError(
                f"{error}, and its limit on the size of messages: it was lost over the births"
            ) from error

    async def _repeat(self, session: BrokerSession) -> None:
        """Send what the broker is to keep again, but nothing out of turn of what still waits."""
        name = self._format.name
        waiting, last = await self._spool.call(
            lambda spool: (spool.read(spool.confirmed(name), 1), spool.last_id)
        )
        before = waiting[0].id if waiting else last + 1
        try:
            await self._publish(session, self._format.repeats(before))
        except BrokerRefusalError:
            # What it refuses now would keep every connection from what waits.
            self._format.forget_repeats()
            raise

    async def _deliver(self, session: BrokerSession) -> None:
        """Send what there is, then wait for more; return when the daemon stops."""
        stop_at: float | None = None
        while True:
            self._wake.clear()
            await self._answer(session)
            now = time.monotonic()
            if not self._refusals:
                self._connections.note_work()
            if now >= self._look_at:
                await self._publish(session, self._format.note_health(self._health()))
                self._look_at = now + HEALTH_EVERY
            if self._stopping and stop_at is None:
                stop_at = now + STOP_WITHIN
            if stop_at is not None and now >= stop_at:
                return
            if await self._send_batch(session):
                continue
            if self._stopping:
                return
            try:
                async with asyncio.timeout(max(0.0, self._look_at - time.monotonic())):
                    await self._wake.wait()
            except TimeoutError:
                continue

    async def _answer(self, session: BrokerSession) -> None:
        for incoming in session.take_incoming():
            await self._publish(session, self._format.receive(incoming, self._health()))
            self._look_at = 0.0
        if session.overrun:
            self._tell(
                "command.overrun",
                f"mqtt {self._format.name}",
                f"{session.overrun} commands were dropped because too many came at once; find out "
                "who sends them",
                bad=True,
            )
            session.overrun = 0

    async def _send_batch(self, session: BrokerSession) -> bool:
        """Send the next messages; return whether there were any."""
        name, limit = self._format.name, self._batch
        messages, stream = await self._spool.call(
            lambda spool: (spool.read(spool.confirmed(name), limit), spool.stream)
        )
        if not messages:
            self._waiting = 0
            return False
        packets = [packet for message in messages for packet in self._encode(message)]
        last = messages[-1].id
        try:
            await self._send(session, packets)
        except BrokerRefusalError:
            if self._is_to_be_skipped(len(messages)):
                await self._skip(last, stream)
            raise
        await self._spool.call(lambda spool: spool.confirm(name, last, stream))
        self._refusals, self._batch = 0, min(BATCH, 2 * self._batch)
        self._delivered += len(messages)
        self._waiting = max(0, self._spool.last_id - last)
        return True

    def _encode(self, message: Message) -> list[Outgoing]:
        """Return a message's packets; one that has none must not hold up all that follow."""
        try:
            return list(self._format.encode(message))
        except Exception as error:  # noqa: BLE001  (told; the others are sent)
            self._skipped += 1
            name = f"mqtt {self._format.name}"
            self._defect(name, error, f"message {message.id} is left out")
            return []

    async def _publish(self, session: BrokerSession, packets: Iterable[Outgoing]) -> None:
        try:
            await session.publish(packets)
        finally:
            for one in session.take_too_large():
                self._note_too_large(one)

    def _note_too_large(self, one: TooLarge) -> None:
        self._skipped += 1
        if count := self._large.note("too large"):
            limit = f"at most {one.limit} bytes" if one.limit else "no message of this size"
            self._tell(
                "mqtt.skipped",
                f"mqtt {self._format.name}",
                f"the message on {one.topic} is left out: it has {one.size} bytes, and the broker "
                f"takes {limit}; raise its limit ({count} since the last such line)",
                bad=True,
            )

    async def _send(self, session: BrokerSession, packets: Iterable[Outgoing]) -> None:
        await self._publish(session, packets)
        if not self._format.confirms:
            await session.subscribe(self._format.subscriptions())

    def _is_to_be_skipped(self, messages: int) -> bool:
        """Whether the broker has closed the connection over a single message again and again."""
        self._batch = 1
        if messages > 1:
            return False
        self._refusals += 1
        return self._refusals >= REFUSALS

    async def _skip(self, number: int, stream: str) -> None:
        name = self._format.name
        await self._spool.call(lambda spool: spool.confirm(name, number, stream))
        self._refusals = 0
        self._skipped += 1
        self._tell(
            "mqtt.skipped",
            f"mqtt {name}",
            f"message {number} is skipped: the broker refused it or closed the connection over it "
            f"{REFUSALS} times; check its limits on the size of messages and its access rules",
            bad=True,
        )

    async def _count_waiting(self) -> None:
        name = self._format.name
        self._waiting = await self._spool.call(lambda spool: spool.waiting(name))

    def _note_loss(self, said: str) -> None:
        if not self._stopping:
            self._connections.note_failure(said)
