"""One connection to an MQTT broker, from CONNECT to DISCONNECT.

paho-mqtt's own thread does the network; what it reports is handed to the event loop, where all
bookkeeping happens. A connection that is lost is never revived: who holds it opens a new one, with
a new will.
"""

from __future__ import annotations

import asyncio
import math
import socket
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

from fieldlink.tls_words import distrust_remedy, tls_remedy, tls_words
from fieldlink.upward.broker_settings import BrokerSettings
from fieldlink.upward.errors import BrokerError, BrokerRefusalError, BrokerVersionError
from fieldlink.upward.packets import Incoming, MqttVersion, Outgoing, TooLarge

__all__ = ["BrokerSession"]

CONNECT_WITHIN = 5.0
"""Seconds for the TCP connection: as long as a lost packet is sent again three times."""

ANSWER_WITHIN = 10.0
"""Seconds for an acknowledgement; a broker that takes longer is taken for gone."""

GOODBYE_WITHIN = 2.0
"""Seconds for the last packets of a session; without them the broker publishes the will."""

MOST_INCOMING = 100
"""Commands that may wait; no operator sends more."""

OVERHEAD = 14
"""Bytes of a PUBLISH beside topic and payload, at most: MQTT 5, 3.3, without properties."""

TOO_LARGE = 0x95
"""Reason code of an acknowledgement: the broker takes no packet of this size."""

REASON_WITHIN = 1.0
"""Seconds until it is known why a connection was lost that does not take a packet any more."""

_UNSUITED = ("Unsupported protocol version", "Retain not supported", "QoS not supported")
"""Answers to CONNECT after which MQTT 3.1.1 may do: there a broker may bear what it lacks."""

_WORDS = dict.fromkeys(("", "Unspecified error"), "it was closed without a reason")
"""What paho says where the broker said nothing."""


class BrokerSession:
    """A connection.

    Args:
        settings: the broker.
        will: what the broker publishes when the connection is lost.
        wake: set when a message came in or the connection was lost.
        version: of MQTT.

    Attributes:
        was_reached: whether CONNECT may have been sent.
        overrun: messages from the broker that were dropped because too many came at once.
    """

    def __init__(
        self, settings: BrokerSettings, will: Outgoing, wake: asyncio.Event, version: MqttVersion
    ) -> None:
        from paho.mqtt import client as paho
        from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

        self._settings = settings
        self._wake = wake
        self._loop = asyncio.get_running_loop()
        self._connected: asyncio.Future[None] = self._loop.create_future()
        self._lost: str | None = None
        self._incoming: list[Incoming] = []
        self._retained: set[Incoming] = set()
        self.overrun = 0
        self.was_reached = False
        self._unanswered: dict[int, Outgoing | None] = {}
        self._refused: str | None = None
        # MQTT 5, 3.2.2.3.3: a broker may end a connection with more messages under way.
        self._most_at_once = 0xFFFF
        # MQTT 5, 3.2.2.3.6: a broker ends a connection over a larger packet; 3.1.1 names no bound.
        self._most_bytes = math.inf
        self._too_large: list[TooLarge] = []
        self._awaited = 1
        self._answered = asyncio.Event()
        self._closed = asyncio.Event()
        client: Any = paho.Client(
            CallbackAPIVersion.VERSION2,
            client_id=settings.client_id,
            # The session is a clean one: tck-id-message-flow-edge-node-birth-publish-connect
            protocol=MQTTProtocolVersion(version),
            reconnect_on_failure=False,
        )
        client.connect_timeout = CONNECT_WITHIN
        client.max_inflight_messages_set(0)  # what is under way is bounded by the batches
        if settings.username is not None and settings.password is not None:
            client.username_pw_set(settings.username, settings.password.reveal())
        if settings.tls is not None:
            client.tls_set_context(settings.tls)
        client.will_set(will.topic, will.payload, will.qos, will.retain)
        client.on_connect = lambda *args: self._hand(self._on_connect, args[3], args[4])
        client.on_disconnect = lambda *args: self._hand(self._on_lost, str(args[3]))
        client.on_publish = lambda *args: self._hand(self._on_answer, args[2], args[3])
        client.on_subscribe = lambda *args: self._hand(self._on_subscribed, args[2], args[3])
        client.on_message = lambda *args: self._receive(args[2])
        self._client = client

    async def open(self) -> None:
        """Connect.

        Raises:
            BrokerError: the broker does not answer, or refuses us; `BrokerVersionError` where that
                may be for the version of MQTT.
        """
        settings = self._settings
        try:
            await asyncio.to_thread(
                self._client.connect, settings.host, settings.port, settings.keepalive
            )
        except (OSError, ValueError) as error:
            remedy = tls_remedy(error, "mqtt.tls.ca", "mqtt.tls.cert")
            raise BrokerError(
                f"no connection to the broker {settings.where}: {tls_words(error)}; "
                f"{remedy or 'check that it runs, its address, and whether its port is for TLS'}"
            ) from error
        self.was_reached = True
        self._client.loop_start()
        await asyncio.wait([self._connected], timeout=ANSWER_WITHIN)
        if not self._connected.done():
            raise BrokerError(
                f"the broker {settings.where} does not answer CONNECT; check that it is not stuck, "
                "and whether it takes more clients"
            )
        self._connected.result()

    async def subscribe(self, filters: Sequence[str]) -> None:
        """Subscribe with QoS 1 and wait for the answer.

        The broker works through what it gets in order, so the answer also proves that everything
        sent before has reached it, QoS 0 included.

        Raises:
            BrokerError: no answer, or the broker does not allow it.
        """
        result, number = self._client.subscribe([(name, 1) for name in filters])
        await self._expect(result, number, None)
        await self._answered_below(1)

    async def publish(self, messages: Iterable[Outgoing]) -> None:
        """Send messages in order and wait until those with QoS 1 are acknowledged.

        Those that are larger than the broker takes are left out, see `take_too_large`.

        Raises:
            BrokerRefusalError: the broker refused one of them; the connection may still stand.
            BrokerError: the connection was lost; what has arrived is not known.
        """
        for message in messages:
            if (size := _size_of(message)) > self._most_bytes:
                self._too_large.append(TooLarge(message.topic, size, int(self._most_bytes)))
                continue
            if len(self._unanswered) >= self._most_at_once:
                await self._answered_below(self._most_at_once)
            info = self._client.publish(message.topic, message.payload, message.qos, message.retain)
            if message.qos:
                await self._expect(info.rc, info.mid, message)
            elif info.rc:
                raise await self._loss()
        await self._answered_below(1)
        if self._refused is not None:
            raise BrokerRefusalError(self._refused)

    def take_too_large(self) -> list[TooLarge]:
        """Return the messages left out since the last call, as larger than the broker takes."""
        taken, self._too_large = self._too_large, []
        return taken

    def take_incoming(self) -> list[Incoming]:
        """Return the messages that came since the last call.

        Raises:
            BrokerError: the connection was lost.
        """
        if self._lost is not None:
            raise self._gone()
        taken, self._incoming = self._incoming, []
        return taken

    def abort(self) -> None:
        """Give the connection up: callers that wait for it get a `BrokerError`."""
        self._on_lost("fieldlink stops")

    async def close(self, farewell: Sequence[Outgoing] = ()) -> None:
        """Say goodbye where the connection still stands, and let go of it.

        Args:
            farewell: sent last; with it the broker does not publish the will.
        """
        if farewell and self._lost is None and self._connected.done():
            try:
                await self.publish(farewell)
            except BrokerError:
                # The broker is gone too, and publishes the will when it notices.
                pass
            else:
                self._client.disconnect()
                with suppress(TimeoutError):
                    async with asyncio.timeout(GOODBYE_WITHIN):
                        await self._closed.wait()
        await asyncio.to_thread(self._end)
        if self._connected.done():
            self._connected.exception()
        # The client's callbacks hold this object: cut loose, it closes its last sockets at once.
        del self._client

    def _end(self) -> None:
        """Close the socket, which ends paho's thread; without DISCONNECT the will is published."""
        open_socket = self._client.socket()
        if open_socket is not None:
            # The thread may have closed it since: then there is nothing left to end.
            with suppress(OSError):
                open_socket.shutdown(socket.SHUT_RDWR)
        self._client.loop_stop()

    def _receive(self, message: Any) -> None:
        """Take a message; called in paho's thread, which an error would end with a traceback."""
        try:
            topic = message.topic
        except UnicodeDecodeError:
            # MQTT 5, 1.5.4: a client that gets such a topic has to close the connection.
            self._hand(self._on_lost, "it has sent a topic that is not UTF-8")
            return
        incoming = Incoming.of(topic, message.payload, retained=bool(message.retain))
        self._hand(self._on_message, incoming)

    def _hand(self, work: Any, *values: Any) -> None:
        self._loop.call_soon_threadsafe(work, *values)

    def _on_connect(self, code: Any, properties: Any) -> None:
        if self._connected.done():
            return
        lacks = 0 in (getattr(properties, name, 1) for name in ("RetainAvailable", "MaximumQoS"))
        if lacks or str(code) in _UNSUITED:
            self._connected.set_exception(
                BrokerVersionError(
                    f"the broker {self._settings.where} does not take what we publish ({code}); "
                    "use one with MQTT 5 or 3.1.1, retained messages and QoS 1"
                )
            )
        elif code.is_failure:
            self._connected.set_exception(
                BrokerError(
                    f"the broker {self._settings.where} refuses the connection: {code}; check "
                    "user, password, certificates, and whether it takes more clients"
                )
            )
        else:
            self._most_at_once = getattr(properties, "ReceiveMaximum", self._most_at_once)
            self._most_bytes = getattr(properties, "MaximumPacketSize", self._most_bytes)
            self._connected.set_result(None)

    def _on_lost(self, reason: str) -> None:
        self._lost = self._lost or reason
        if not self._connected.done():
            remedy = "check whether it takes more clients, and the broker's log"
            if self._settings.tls is not None:
                # TLS 1.3: a certificate is refused after the handshake.
                remedy = f"{distrust_remedy('mqtt.tls.cert')}, or {remedy}"
            self._connected.set_exception(
                BrokerVersionError(
                    f"the broker {self._settings.where} closed the connection at CONNECT: "
                    f"{_WORDS.get(reason, reason)}; {remedy}"
                )
            )
        self._closed.set()
        self._answered.set()
        self._wake.set()

    def _on_answer(self, number: int, code: Any = None) -> None:
        message = self._unanswered.pop(number, None)
        if message is not None and code.is_failure:
            if code.value == TOO_LARGE:
                self._too_large.append(TooLarge(message.topic, _size_of(message), 0))
            elif self._refused is None:
                self._refused = (
                    f"the broker {self._settings.where} refuses messages on {message.topic}: "
                    f"{code}; give our user the right to publish there"
                )
        if len(self._unanswered) < self._awaited:
            self._answered.set()

    def _on_subscribed(self, number: int, codes: Sequence[Any]) -> None:
        if any(code.is_failure for code in codes):
            self._on_lost("the broker's access rules forbid a subscription")
        self._on_answer(number)

    def _on_message(self, message: Incoming) -> None:
        if message.retained:
            # every subscription that confirms a delivery brings them again
            if message in self._retained:
                return
            if len(self._retained) < MOST_INCOMING:
                self._retained.add(message)
        if len(self._incoming) < MOST_INCOMING:
            self._incoming.append(message)
        else:
            self.overrun += 1
        self._wake.set()

    async def _expect(self, result: int, number: int, message: Outgoing | None) -> None:
        if result:
            raise await self._loss()
        self._unanswered[number] = message

    async def _answered_below(self, count: int) -> None:
        """Wait until fewer than ``count`` packets are unanswered."""
        self._awaited = count
        while len(self._unanswered) >= count:
            if self._lost is not None:
                raise self._gone()
            before = len(self._unanswered)
            self._answered.clear()
            try:
                async with asyncio.timeout(ANSWER_WITHIN):
                    await self._answered.wait()
            except TimeoutError:
                if len(self._unanswered) < before:
                    continue
                raise BrokerError(
                    f"the broker {self._settings.where} does not acknowledge within "
                    f"{ANSWER_WITHIN:g} s; check its load and the network"
                ) from None

    async def _loss(self) -> BrokerError:
        """Return what to raise when the client takes nothing more: its thread tells the reason."""
        with suppress(TimeoutError):
            async with asyncio.timeout(REASON_WITHIN):
                await self._closed.wait()
        return self._gone()

    def _gone(self) -> BrokerError:
        return BrokerRefusalError(
            f"the connection to the broker {self._settings.where} was lost: "
            f"{_WORDS.get(self._lost or '', self._lost)}; check the broker's log"
        )


def _size_of(message: Outgoing) -> int:
    """The most bytes that a message takes on the wire."""
    return len(message.topic.encode()) + len(message.payload) + OVERHEAD
