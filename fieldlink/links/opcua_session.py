"""One session with an OPC UA server: connect, read, subscribe, write; asyncua does the protocol.

Everything that asyncua raises becomes a `LinkError` here. A session that has failed is not revived:
the link closes it and opens another one after a pause.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from asyncua import Client, ua
from asyncua.crypto import security_policies
from asyncua.ua.uaerrors import UaError

from fieldlink.links.errors import LinkError, LinkTimeoutError, LinkUnreachableError
from fieldlink.links.names import find_addresses
from fieldlink.links.opcua_values import (
    NOT_THERE,
    NodeValue,
    help_for,
    node_value,
    stamp_of,
    status_of,
)
from fieldlink.links.usual_delay import UsualDelay

if TYPE_CHECKING:
    from fieldlink.links.clock import Clock
    from fieldlink.site import Device, Site

__all__ = ["OpcuaSession", "StatusError"]

CONNECT_ROUND_TRIPS = 6
"""Hello, channel, endpoints, session, activation and namespaces: each may take a time-out."""

SESSION_LIFE = 60_000.0
"""Milliseconds after which a server may forget a session that is silent: an edge box that loses
power must not use up the server's sessions for an hour."""

PERIODS_SILENT = 3.0
"""Periods without a report, and a second more, after which a subscription is given up; the server
sends a sign of life twice a period."""

# asyncua logs what it raises too; the daemon logs it once, with the remedy.
for _name in ("asyncua", "asyncua.client", "asyncua.common"):
    logging.getLogger(_name).addHandler(logging.NullHandler())
logging.getLogger("asyncua").setLevel(logging.CRITICAL)


class StatusError(LinkError):
    """The server answered a request with a bad status code."""


class OpcuaSession:
    """A session; every method raises `LinkError`.

    Args:
        name: of the device.
        device: how the server is reached.
        site: the site that the files belong to.
        clock: tells when the server was heard.
    """

    def __init__(self, name: str, device: Device, site: Site, clock: Clock) -> None:
        self._name, self._device, self._site, self._clock = name, device, site, clock
        self._client = Client(device.where, timeout=device.timeout)
        self._client.application_uri = device.opcua.application_uri
        self._client.name = self._client.description = "fieldlink"
        self._client.session_timeout = SESSION_LIFE
        self._nodes: dict[str, Any] = {}
        self._text_of: dict[Any, str] = {}
        self._namespaces: list[str] = []
        self._subscription: Any = None
        self._latest: dict[str, NodeValue] = {}
        self._delays, self._usual = UsualDelay(), 0.0
        self._stamps: dict[str, float | None] = {}
        self._late: set[str] = set()
        self._published: float | None = None
        self._reported = asyncio.Event()
        self._period = 1.0

    async def open(self) -> None:
        """Connect and activate the session."""
        device = self._device
        limit = CONNECT_ROUND_TRIPS * device.timeout
        try:
            async with asyncio.timeout(limit):
                await self._secure()
                # asyncua looks the name up in the threads that all share: not before it is known.
                await find_addresses(device.host or "")
                await self._client.connect()
                if any(tag.node.startswith("nsu=") for tag in self._tags()):
                    self._namespaces = await self._client.get_namespace_array()
        except TimeoutError as error:
            raise self._unreachable(f"no answer within {limit:g} s") from error
        except UaError as error:
            raise self._unreachable(status_of(error)) from error
        except (OSError, ValueError) as error:
            raise self._unreachable(getattr(error, "strerror", None) or str(error)) from error

    async def read(self, nodes: Sequence[str]) -> list[NodeValue]:
        """Read values in one request."""
        values = await self._ask(
            "reading",
            self._client.uaclient.read_attributes(
                [self._node(node).nodeid for node in nodes], ua.AttributeIds.Value
            ),
        )
        if len(values) != len(nodes):
            raise LinkUnreachableError(
                self._name,
                f"{self._device.where} gave {len(values)} values for {len(nodes)} nodes",
                "look at the server",
            )
        return [node_value(value) for value in values]

    async def subscribe(self, nodes: Sequence[str], period: float) -> None:
        """Have the server report values when they change, at most ``period`` seconds old."""
        self._period = period
        milliseconds = 500.0 * period
        settings = ua.CreateSubscriptionParameters(
            RequestedPublishingInterval=milliseconds,
            RequestedLifetimeCount=100,
            RequestedMaxKeepAliveCount=1,
            PublishingEnabled=True,
        )

        async def begin() -> list[Any]:
            self._subscription = await self._client.create_subscription(settings, self)
            return list(
                await self._subscription.subscribe_data_change(
                    [self._node(node) for node in nodes],
                    queuesize=1,
                    sampling_interval=milliseconds,
                )
            )

        handles = await self._ask("subscribing", begin())
        for node, handle in zip(nodes, handles, strict=True):
            if isinstance(handle, ua.StatusCode):
                self._latest[node] = NodeValue(None, handle.name, False, handle.name in NOT_THERE)
        await self._wait_for_first(nodes)

    async def _wait_for_first(self, nodes: Sequence[str]) -> None:
        """Wait until the server has reported every node once, at most for a time-out."""
        with suppress(TimeoutError):
            async with asyncio.timeout(self._device.timeout):
                while not all(node in self._latest for node in nodes):
                    self._reported.clear()
                    await self._reported.wait()

    def datachange_notification(self, node: Any, _: Any, data: Any) -> None:
        """Take a value that the server reports; called by asyncua."""
        key = self._text_of.get(node.nodeid)
        if key is None:
            return
        report = data.monitored_item.Value
        self._note_delay(key, stamp_of(report))
        self._latest[key] = node_value(report)
        self._reported.set()

    def _note_delay(self, node: str, stamp: float | None) -> None:
        """Note whether a report is of a period ago: a server or a network that stood still.

        Only stamps that advance tell it. The first of a node may be of any age, since many servers
        stamp a value when it changes.
        """
        published = None if self._subscription is None else self._subscription.last_publish_at
        before = self._stamps.get(node)
        self._stamps[node] = stamp
        if published is None or stamp is None or before is None or stamp <= before:
            return
        delay = published - stamp
        if published != self._published:
            self._published = published
            self._late.clear()
            self._usual = delay - self._delays.exceed(delay)
        if delay - self._usual > self._period:
            self._late.add(node)

    def status_change_notification(self, status: Any) -> None:  # noqa: ARG002
        """Note that the server has ended the subscription; called by asyncua."""
        self._subscription = None

    def latest(self, node: str) -> NodeValue | None:
        """Return the newest reported value of a subscribed node; None before the first."""
        found = self._latest.get(node)
        return found if found is None or node not in self._late else replace(found, late=True)

    def check_reports(self) -> None:
        """Raise when the server has not been heard since the scan before.

        Raises:
            StatusError: for a period; what it reported before may be old, the session goes on.
            LinkTimeoutError: for so long that the session is given up.
        """
        heard = None if self._subscription is None else self._subscription.last_publish_at
        silent = 0.0 if heard is None else self._clock.monotonic() - heard
        if heard != self._published:
            # what has not been reported again since has not changed since
            self._late.clear()
        if self._subscription is not None and silent <= self._period:
            return
        what = f"{self._device.where} has reported nothing for {silent:.1f} s"
        advice = "look at the server; the values it reported before are not used"
        if self._subscription is None or silent > PERIODS_SILENT * self._period + 1.0:
            raise LinkTimeoutError(self._name, what, advice)
        raise StatusError(self._name, what, advice)

    async def read_words(self, node: str, first: int, count: int) -> list[int]:
        """Read a part of an array of UInt16."""
        item = ua.ReadValueId(
            NodeId=self._node(node).nodeid,
            AttributeId=ua.AttributeIds.Value,
            IndexRange=_index_range(first, count),
        )
        parameters = ua.ReadParameters(NodesToRead=[item])
        found = await self._ask("reading", self._client.uaclient.read(parameters))
        value = node_value(found[0])
        if status := _status_of_words(value, count):
            raise self._refused(f"elements {first} to {first + count - 1} of {node}", status)
        return list(value.value)

    async def write_words(self, node: str, first: int, words: Sequence[int]) -> None:
        """Write a part of an array of UInt16 in one request; never repeated."""
        item = ua.WriteValue(
            NodeId=self._node(node).nodeid,
            AttributeId=ua.AttributeIds.Value,
            IndexRange=_index_range(first, len(words)),
            Value=ua.DataValue(ua.Variant(list(words), ua.VariantType.UInt16, is_array=True)),
        )
        parameters = ua.WriteParameters(NodesToWrite=[item])
        codes = await self._ask("writing", self._client.uaclient.write(parameters))
        if not codes[0].is_good():
            last = first + len(words) - 1
            raise self._refused(f"writing elements {first} to {last} of {node}", codes[0].name)

    async def close(self) -> None:
        """End the session; a server that is gone is not waited for."""
        with suppress(TimeoutError, OSError, UaError):
            async with asyncio.timeout(2.0 * self._device.timeout):
                await self._client.disconnect()
        self._client.disconnect_socket()

    async def _ask(self, what: str, request: Any) -> Any:
        try:
            async with asyncio.timeout(self._device.timeout):
                return await request
        except TimeoutError as error:
            raise LinkTimeoutError(
                self._name,
                f"{what}: no answer from {self._device.where} within {self._device.timeout:g} s",
                "raise the timeout, or look at the server's load",
            ) from error
        except UaError as error:
            raise self._unreachable(f"{what}: {status_of(error)}") from error
        except OSError as error:
            raise self._unreachable(f"{what}: {error.strerror or error}") from error

    async def _secure(self) -> None:
        settings = self._device.opcua
        if settings.username is not None and settings.password_file is not None:
            self._client.set_user(settings.username)
            file = self._site.resolve(settings.password_file)
            self._client.set_password(file.read_text(encoding="utf-8").strip("\r\n"))
        if settings.security == "none":
            return
        assert settings.cert is not None
        assert settings.key is not None
        assert settings.server_cert is not None
        policy = getattr(security_policies, f"SecurityPolicy{settings.security.replace('_', '')}")
        mode = ua.MessageSecurityMode
        await self._client.set_security(
            policy,
            str(self._site.resolve(settings.cert)),
            str(self._site.resolve(settings.key)),
            server_certificate=str(self._site.resolve(settings.server_cert)),
            mode=mode.SignAndEncrypt if settings.encrypt else mode.Sign,
        )

    def _tags(self) -> list[Any]:
        return list(self._site.maps.get(self._name, {}).values())

    def _node(self, text: str) -> Any:
        node = self._nodes.get(text)
        if node is None:
            node = self._nodes[text] = self._client.get_node(self._numbered(text))
            self._text_of[node.nodeid] = text
        return node

    def _numbered(self, text: str) -> str:
        """Return a node id with the server's number for a namespace that is given by its URI."""
        if not text.startswith("nsu="):
            return text
        uri, _, rest = text.removeprefix("nsu=").partition(";")
        if uri not in self._namespaces:
            raise LinkUnreachableError(
                self._name, f"the server has no namespace {uri}", "correct the node map"
            )
        return f"ns={self._namespaces.index(uri)};{rest}"

    def _refused(self, what: str, status: str) -> StatusError:
        help_text = help_for(status)
        return StatusError(self._name, f"{what}: status {status}", help_text)

    def _unreachable(self, why: str) -> LinkUnreachableError:
        return LinkUnreachableError(
            self._name,
            f"no session with {self._device.where}: {why}",
            "check that the server runs, its address, its certificates and its limit of sessions",
        )


def _status_of_words(value: NodeValue, count: int) -> str:
    """The status code that names what is wrong with a part of an array; empty when it is whole."""
    if not value.good:
        return value.status
    words = value.value if isinstance(value.value, list) else []
    if len(words) != count:
        # A range beyond the array is answered with what there is of it; more comes from a server
        # that knows no ranges.
        return "BadIndexRangeNoData" if len(words) < count else "BadIndexRangeInvalid"
    is_sound = all(type(word) is int and 0 <= word <= 0xFFFF for word in words)
    return "" if is_sound else "BadTypeMismatch"


def _index_range(first: int, count: int) -> str:
    return str(first) if count == 1 else f"{first}:{first + count - 1}"
