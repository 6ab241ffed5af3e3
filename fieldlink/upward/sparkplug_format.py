"""Sparkplug B over a connection: the edge node's births, data and deaths, and its commands."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Sequence

from fieldlink.site import Site
from fieldlink.upward.commands import CommandDesk
from fieldlink.upward.formats import Health
from fieldlink.upward.messages import Message
from fieldlink.upward.packets import Incoming, Outgoing
from fieldlink.upward.sparkplug_metrics import COMMAND_METRICS
from fieldlink.upward.sparkplug_node import REBIRTH, EdgeNode
from fieldlink.upward.sparkplug_payload import PayloadError, decode

__all__ = ["SparkplugFormat"]

MOST_METRICS = 20
"""Metrics of a command: each one is an event, and a loop has two of them."""

BIRTHS_AT_ONCE, BIRTHS_WITHIN = 3, 15.0
"""Births that hosts may ask for within so many seconds; the next one waits for their end. A host
that starts asks once or twice, and one that asks without end must not have all loops told for it
again and again."""

_COMMAND_OF = {spec.name: command for command, spec in COMMAND_METRICS.items()}


class SparkplugFormat:
    """The Sparkplug format of a site.

    Args:
        site: the site.
        desk: takes the commands to loops.
        version: of the program.
    """

    name = "sparkplug"
    # tck-id-topics-nbirth-mqtt and the others: everything but the will goes with QoS 0.
    confirms = False
    retained = ()

    def __init__(self, site: Site, desk: CommandDesk, version: str) -> None:
        mqtt = site.file.mqtt
        assert mqtt is not None
        self._desk = desk
        self._node = EdgeNode(
            mqtt.group or site.name, mqtt.node, mqtt.publish, mqtt.commands, version
        )
        self._bdseq = 0
        self._changed = self._asked = False
        self._births: deque[float] = deque(maxlen=BIRTHS_AT_ONCE)
        self.follow(site, "")

    def follow(self, site: Site, stream: str) -> None:
        """Take a site's loops as devices; the next look gives a birth to all of them."""
        self._node.follow(site.loops, stream)
        self._changed = True

    def note(self, message: Message) -> None:
        """Take a message's values as the newest ones."""
        self._node.note(message)

    def repeats(self, before: int) -> Iterable[Outgoing]:  # noqa: ARG002
        """Return nothing: the births have what is newest."""
        return ()

    def forget_repeats(self) -> None:
        """Repeat nothing."""

    def will(self, birth: int) -> Outgoing:
        """Return the NDEATH of a session."""
        self._bdseq = birth
        return self._node.death(birth)

    def subscriptions(self) -> Sequence[str]:
        """Return the filters of commands to the node and to its devices."""
        return self._node.subscriptions

    def begin(self, health: Health) -> Iterable[Outgoing]:
        """Return the births."""
        self._changed = self._asked = False
        self._births.append(time.monotonic())
        return self._node.birth(health)

    def encode(self, message: Message) -> Iterable[Outgoing]:
        """Return the data messages of what has changed."""
        return self._node.data(message)

    def note_health(self, health: Health) -> Iterable[Outgoing]:
        """Return changed states, births and deaths of loops."""
        if self._changed or (self._asked and self._may_be_born()):
            return [*self._node.bury(), *self.begin(health)]
        return self._node.note_health(health)

    def _may_be_born(self) -> bool:
        oldest = self._births[0]
        return len(self._births) < BIRTHS_AT_ONCE or time.monotonic() - oldest >= BIRTHS_WITHIN

    def receive(self, incoming: Incoming, health: Health) -> Sequence[Outgoing]:  # noqa: ARG002
        """Have commands carried out; the next look answers all rebirth requests with one birth."""
        try:
            payload = decode(incoming.payload)
        except PayloadError:
            self._desk.handle("unreadable payload", None, "", topic=incoming.topic)
            return ()
        if incoming.too_long or len(payload.metrics) > MOST_METRICS:
            refusal = incoming.refusal or (
                f"the message has {len(payload.metrics)} metrics; a command has at most "
                f"{MOST_METRICS}"
            )
            self._desk.handle("command", None, "", topic=incoming.topic, refusal=refusal)
            return ()
        is_node = incoming.topic == self._node.topic("NCMD")
        loop = None if is_node else self._node.find_loop(incoming.topic)
        for metric in payload.metrics:
            name = self._node.find_metric(loop, metric)
            if is_node and name == REBIRTH:
                # tck-id-operational-behavior-data-commands-rebirth-action-1 to -3
                self._asked |= metric.value is True and not incoming.retained
                continue
            if metric.value is False:
                continue
            self._desk.handle(
                _COMMAND_OF.get(name or "", name or "a metric without a name"),
                loop,
                metric.value if isinstance(metric.value, str) else "",
                topic=incoming.topic,
                refusal=incoming.refusal,
            )
        return ()

    def farewell(self) -> Sequence[Outgoing]:
        """Return the NDEATH: a clean DISCONNECT makes the broker forget the will."""
        return (self._node.death(self._bdseq),)
