"""One session with an OPC UA server: connect, read, subscribe, write; asyncua does the protocol.

Everything that asyncua raises becomes a `LinkError` here. A session that has failed is not revived:
the link closes it and opens another one after a pause.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from asyncua import Client, ua
from asyncua.ua.uaerrors import UaError

from fieldlink.links.errors import LinkError, LinkTimeoutError, LinkUnreachableError
from fieldlink.links.names import find_addresses
from fieldlink.links.opcua_certificates import find_stranger, secure
from fieldlink.links.opcua_looks import Looks
from fieldlink.links.opcua_reports import SHARE, Reports
from fieldlink.links.opcua_subscription import begin_reports
from fieldlink.links.opcua_values import (
    UNREADABLE,
    NodeValue,
    help_for,
    index_range,
    node_value,
    not_there,
    status_of,
    status_of_words,
    uri_of,
)
from fieldlink.links.reasons import reason_of
from fieldlink.opcua_keys import KeyFileError

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
sends a sign of life four times a period."""

FAREWELL = 3.0
"""Most seconds for the end of a session; a server that is silent forgets it by itself."""

LIFE_SHARE = 0.5
"""Share of `SESSION_LIFE` for which a server keeps a subscription that nothing is fetched of."""

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
        looks: when reported nodes are read as well; those of the session before, if there was one.
    """

    def __init__(
        self, name: str, device: Device, site: Site, clock: Clock, looks: Looks | None = None
    ) -> None:
        self._name, self._device, self._site, self._clock = name, device, site, clock
        self._looks = looks or Looks()
        self._client = Client(device.where, timeout=device.timeout)
        self._client.application_uri = device.opcua.application_uri
        self._client.name = self._client.description = "fieldlink"
        self._client.session_timeout = SESSION_LIFE
        self._nodes: dict[str, Any] = {}
        self._namespaces: list[str] = []
        self._reports = Reports(1.0)
        self._reported = asyncio.Event()
        self._period = 1.0

    async def open(self) -> None:
        """Connect and activate the session."""
        try:
            await self._connect()
        except LinkError as error:
            if (stranger := await self._find_stranger()) is None:
                raise
            raise stranger from error

    async def _find_stranger(self) -> LinkUnreachableError | None:
        """Return what to tell of a server whose certificate is not the one that we know."""
        device, known = self._device, self._device.opcua.server_cert
        if device.opcua.security == "none" or known is None:
            return None
        file = self._site.resolve(known)
        thumbprint = await find_stranger(device.where, file, device.timeout)
        if not thumbprint:
            return None
        return LinkUnreachableError(
            self._name,
            f"{device.where} shows another certificate than {known} (thumbprint {thumbprint})",
            "if the server was given a new one, compare its thumbprint there, and put the "
            "certificate into server_cert",
        )

    async def _connect(self) -> None:
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
            status = status_of(error)
            raise self._unreachable(status, status) from error
        except KeyFileError as error:
            raise LinkUnreachableError(self._name, error.what, error.remedy) from error
        except OSError as error:
            if error.filename is not None:
                raise LinkUnreachableError(
                    self._name,
                    f"the file {error.filename} cannot be read: {error.strerror}",
                    "check its path and its permissions",
                ) from error
            raise self._unreachable(reason_of(error)) from error
        except UNREADABLE as error:
            said = str(error) or "it makes no sense"
            raise self._unreachable(f"its answer cannot be read ({said})") from error

    async def read(self, nodes: Sequence[str]) -> list[NodeValue]:
        """Read values in one request."""
        known = [node for node in nodes if self._has_namespace(node)]
        values = (
            await self._ask(
                "reading",
                self._client.uaclient.read_attributes(
                    [self._node(node).nodeid for node in known], ua.AttributeIds.Value
                ),
            )
            if known
            else []
        )
        if len(values) != len(known):
            raise LinkUnreachableError(
                self._name,
                f"{self._device.where} gave {len(values)} values for {len(known)} nodes",
                "look at the server",
            )
        found = {node: node_value(value) for node, value in zip(known, values, strict=True)}
        return [found[node] if node in found else not_there(node) for node in nodes]

    async def subscribe(self, nodes: Sequence[str], period: float) -> None:
        """Have the server report values when they change.

        Args:
            nodes: whose values.
            period: seconds from one look at them to the next.
        """
        self._period, self._reports = period, Reports(period)
        self._looks.begin(nodes, self._clock.monotonic())
        await self._ask("subscribing", self._begin_reports(nodes, 1000.0 * SHARE * period))
        for node in nodes:
            if not self._has_namespace(node):
                self._reports.refuse(node, not_there(node).status, refused=True)
        await self._wait_for_first(nodes)

    async def _begin_reports(self, nodes: Sequence[str], milliseconds: float) -> None:
        await begin_reports(
            self._client.uaclient.session,
            {node: self._node(node).nodeid for node in nodes if self._has_namespace(node)},
            self._reports,
            milliseconds,
            LIFE_SHARE * SESSION_LIFE,
            self._take,
        )

    async def _wait_for_first(self, nodes: Sequence[str]) -> None:
        """Wait until the server has reported every node once, at most for a time-out."""
        with suppress(TimeoutError):
            async with asyncio.timeout(self._device.timeout):
                while not all(self._reports.has(node) for node in nodes):
                    self._reported.clear()
                    await self._reported.wait()

    def _take(self, result: Any) -> None:
        """Take a message of the server; called by asyncua."""
        self._reports.take(result, self._clock.monotonic())
        self._reported.set()

    def latest(self, node: str) -> NodeValue | None:
        """Return the newest reported value of a subscribed node; None before the first."""
        return self._reports.latest(node)

    async def check_reports(self, until: float) -> None:
        """Raise when the reported values may be too old.

        A message that has come while this process had no turn is still to be taken, and one that
        is a little late is worth a wait.

        Args:
            until: the moment of our clock up to which a message is waited for.

        Raises:
            StatusError: what it reported may be too old; the session goes on.
            LinkTimeoutError: it has said nothing for so long that the session is given up.
        """
        reports, clock = self._reports, self._clock
        while (
            not reports.ended and not self._is_known() and (left := until - clock.monotonic()) > 0
        ):
            self._reported.clear()
            with suppress(TimeoutError):
                async with asyncio.timeout(left):
                    await self._reported.wait()
        if self._is_known() and not reports.ended:
            return
        silent, where = reports.silence(clock.monotonic()), self._device.where
        what = f"{where} has reported nothing for {silent:.1f} s"
        if reports.ended:
            what = f"{where} reports no more: status {reports.ended}"
            if reports.ended == "BadShutdown":  # asyncua says so of a connection that is lost
                what = f"{where} reports no more: it was stopped, or the connection was lost"
        elif silent <= reports.limit - reports.sampling:
            what = f"what {where} has reported may be of before a pause or a delay"
        advice = "look at the server; the values it reported before are not used"
        if reports.ended or silent > PERIODS_SILENT * max(self._period, reports.limit) + 1.0:
            raise LinkTimeoutError(self._name, what, advice)
        raise StatusError(self._name, what, advice)

    async def look_again(self) -> None:
        """Now and then, read some of the reported nodes: the server may report them no more."""
        now, reports = self._clock.monotonic(), self._reports
        if not self._looks.is_due(now):
            return
        nodes = self._looks.choose(reports.doubted, self._device.opcua.max_nodes)
        for node, value in zip(nodes, await self.read(nodes), strict=True):
            reports.compare(node, value)
        # What has changed only now is reported before the second look.
        again_after = 2.0 * reports.limit if reports.doubted else None
        self._looks.saw(len(nodes), now, again_after=again_after)

    @property
    def unwatched(self) -> str:
        """A node that the server seems to report no more; empty without one."""
        return self._reports.unwatched

    def check_watched(self) -> None:
        """Raise when the server has ceased to report a node; the session is given up.

        Raises:
            LinkUnreachableError: it has.
        """
        node = self._reports.unwatched
        if node:
            raise LinkUnreachableError(
                self._name,
                f"{self._device.where} reports {node} no more, which has changed or is gone",
                "a new session is opened, and ever more seldom where that is no cure; if it "
                'persists, take away the server\'s dead band, or use mode = "read"',
            )

    def _is_known(self) -> bool:
        age = self._reports.age(self._clock.monotonic())
        return age is not None and age <= self._reports.limit

    async def read_words(self, node: str, first: int, count: int) -> list[int]:
        """Read a part of an array of UInt16."""
        item = ua.ReadValueId(
            NodeId=self._node(node).nodeid,
            AttributeId=ua.AttributeIds.Value,
            IndexRange=index_range(first, count),
        )
        parameters = ua.ReadParameters(NodesToRead=[item])
        found = await self._ask("reading", self._client.uaclient.read(parameters))
        value = node_value(found[0])
        if status := status_of_words(value, count):
            raise self._refused(f"elements {first} to {first + count - 1} of {node}", status)
        return list(value.value)

    async def write_words(self, node: str, first: int, words: Sequence[int]) -> None:
        """Write a part of an array of UInt16 in one request; never repeated."""
        item = ua.WriteValue(
            NodeId=self._node(node).nodeid,
            AttributeId=ua.AttributeIds.Value,
            IndexRange=index_range(first, len(words)),
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
            async with asyncio.timeout(min(2.0 * self._device.timeout, FAREWELL)):
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
            status = status_of(error)
            raise self._unreachable(f"{what}: {status}", status) from error
        except OSError as error:
            raise self._unreachable(f"{what}: {reason_of(error)}") from error
        except UNREADABLE as error:
            raise LinkUnreachableError(
                self._name,
                f"{what}: {self._device.where} gave an answer that cannot be read ({error})",
                "a new session is opened; if it persists, look at the server and its version",
            ) from error

    async def _secure(self) -> None:
        settings = self._device.opcua
        if settings.username is not None and settings.password_file is not None:
            self._client.set_user(settings.username)
            file = self._site.resolve(settings.password_file)
            self._client.set_password(file.read_text(encoding="utf-8").strip("\r\n"))
        if settings.security == "none":
            return
        await secure(self._client, settings, self._site.resolve)

    def _tags(self) -> list[Any]:
        return list(self._site.maps.get(self._name, {}).values())

    def _node(self, text: str) -> Any:
        node = self._nodes.get(text)
        if node is None:
            node = self._nodes[text] = self._client.get_node(self._numbered(text))
        return node

    def _has_namespace(self, node: str) -> bool:
        """Whether the server has the namespace that a node id names."""
        return not node.startswith("nsu=") or uri_of(node) in self._namespaces

    def _numbered(self, text: str) -> str:
        """Return a node id with the server's number for a namespace that is given by its URI."""
        if not text.startswith("nsu="):
            return text
        uri, rest = uri_of(text), text.partition(";")[2]
        if uri not in self._namespaces:
            raise LinkUnreachableError(
                self._name, f"the server has no namespace {uri}", "correct the node map"
            )
        return f"ns={self._namespaces.index(uri)};{rest}"

    def _refused(self, what: str, status: str) -> StatusError:
        help_text = help_for(status)
        return StatusError(self._name, f"{what}: status {status}", help_text)

    def _unreachable(self, why: str, status: str = "") -> LinkUnreachableError:
        usual = (
            "check that the server runs, its address, its certificates and its limit of sessions"
        )
        return LinkUnreachableError(
            self._name, f"no session with {self._device.where}: {why}", help_for(status, usual)
        )
