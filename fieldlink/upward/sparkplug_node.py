"""A Sparkplug B edge node: births, deaths, sequence numbers, aliases, reports by exception.

Pure: messages in, topics and bytes out. The site is the edge node, its loops are the devices. A
loop is born when its PLC answers or when there is something to tell about it, and dies when its PLC
is lost. What was spooled before a birth is sent after it, marked as historical: the birth has the
newest values already. Rules by their identifiers in the Sparkplug specification 3.0.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Iterator, Mapping

from fieldlink.upward.messages import Message
from fieldlink.upward.packets import Outgoing
from fieldlink.upward.sparkplug_metrics import (
    MESSAGE_ID,
    NODE_EVENTS,
    STREAM,
    VERSION,
    MetricSpec,
    device_health,
    loop_metrics,
    values_of,
)
from fieldlink.upward.sparkplug_payload import DataType, Metric, Payload, Value, encode
from fieldlink.upward.topics import as_level

__all__ = ["REBIRTH", "EdgeNode"]

NAMESPACE = "spBv1.0"
REBIRTH = "Node Control/Rebirth"
BDSEQ = "bdSeq"
SEQUENCE = 256
"""Sequence numbers go from 0 to 255 (tck-id-payloads-sequence-num-incrementing)."""

NODE_ALIASES = 1
"""First alias; aliases are unique in the whole node (tck-id-payloads-alias-uniqueness)."""

_Board = dict[str, tuple[Value, int]]


def _now() -> int:
    return round(1000.0 * time.time())


class EdgeNode:
    """The node and its loops.

    Args:
        group: group id.
        node: edge node id.
        publish: what the site publishes.
        commands: commands that are taken.
        version: of the program, a property of the node.
    """

    def __init__(
        self,
        group: str,
        node: str,
        publish: Collection[str],
        commands: Collection[str],
        version: str,
    ) -> None:
        self._group, self._node = as_level(group), as_level(node)
        self._specs = loop_metrics(publish, commands)
        self._type_of = {spec.name: spec.type for spec in self._specs}
        self._events = NODE_EVENTS if "events" in publish else ()
        self._version = version
        self._stream = ""
        self._board: dict[str, _Board] = {}
        self._node_board: dict[str, tuple[Value, int]] = {}
        self._health: dict[str, tuple[MetricSpec, Value]] = {}
        self._newest = self._historical_until = 0
        self._bdseq = self._seq = 0
        self._aliases: dict[tuple[str, str], int] = {}
        self._born: set[str] = set()
        self._sent: dict[tuple[str, str], Value] = {}

    def topic(self, verb: str, loop: str | None = None) -> str:
        """Return the topic of a message."""
        parts = [NAMESPACE, self._group, verb, self._node]
        return "/".join(parts if loop is None else [*parts, as_level(loop)])

    @property
    def subscriptions(self) -> tuple[str, ...]:
        """Filters of the commands to the node and its devices."""
        return self.topic("NCMD"), f"{self.topic('DCMD')}/#"

    def follow(self, loops: Iterable[str], stream: str) -> None:
        """Take the site's loops as devices; those of before keep their values."""
        self._board = {loop: self._board.get(loop, {}) for loop in loops}
        self._stream = stream

    def note(self, message: Message) -> None:
        """Take a message's values as the newest; in the order of their numbers."""
        self._newest = message.id
        board = self._board.get(message.source)
        if board is not None:
            board.update((name, (value, message.utc_ms)) for name, value in values_of(message))
        elif message.kind == "event":
            self._node_board.update(self._of_node(message))

    def death(self, bdseq: int) -> Outgoing:
        """Return the NDEATH of the next session; the broker gets it as the will."""
        self._bdseq = bdseq
        metric = Metric(BDSEQ, None, DataType.INT64, bdseq, _now())
        data = encode(Payload((metric,), _now(), None))
        # tck-id-payloads-ndeath-will-message-qos, tck-id-topics-ndeath-seq
        return Outgoing(self.topic("NDEATH"), data, qos=1)

    def birth(self, health: Mapping[str, object]) -> Iterator[Outgoing]:
        """Yield NBIRTH and the DBIRTHs of all loops whose device answers."""
        self._health = {spec.name: (spec, value) for spec, value in device_health(health)}
        self._seq, self._sent, self._aliases = -1, {}, {}
        self._born = set()
        self._historical_until = self._newest
        now = _now()
        metrics = [
            Metric(BDSEQ, None, DataType.INT64, self._bdseq, now),
            # tck-id-operational-behavior-data-commands-rebirth-name-aliases: without an alias
            Metric(REBIRTH, None, DataType.BOOLEAN, False, now),
            self._in_birth("", VERSION, self._version, now),
            self._in_birth("", STREAM, self._stream, now),
        ]
        metrics += [self._in_birth("", spec, value, now) for spec, value in self._health.values()]
        for spec in self._events:
            value, utc_ms = self._node_board.get(spec.name, (None, now))
            metrics.append(self._in_birth("", spec, value, utc_ms))
        yield self._outgoing("NBIRTH", None, metrics)
        for loop in self._answering(health):
            yield self._loop_birth(loop)

    def bury(self) -> Iterator[Outgoing]:
        """Yield the DDEATHs of loops that the site does not have any more."""
        for loop in sorted(self._born.difference(self._board)):
            self._born.discard(loop)
            yield self._outgoing("DDEATH", loop, ())

    def data(self, message: Message) -> Iterator[Outgoing]:
        """Yield what a message changes; nothing when it changes nothing."""
        historical = message.id <= self._historical_until
        if message.source not in self._board:
            # a spool may hold events that the site has published before, and does no more
            is_told = message.kind == "event" and self._events
            values = dict(self._of_node(message)) if is_told else {}
            yield from self._changes("NDATA", None, values, historical)
            return
        if message.source not in self._born:
            yield self._loop_birth(message.source)
            # The birth has the newest values, so this message can only be older.
            historical = True
        values = {name: (value, message.utc_ms) for name, value in values_of(message)}
        values = {name: value for name, value in values.items() if name in self._type_of}
        yield from self._changes("DDATA", message.source, values, historical)

    def note_health(self, health: Mapping[str, object]) -> Iterator[Outgoing]:
        """Yield what has changed in the states of devices: NDATA, births and deaths of loops."""
        found = {spec.name: (spec, value) for spec, value in device_health(health)}
        if found.keys() != self._health.keys():
            # tck-id-operational-behavior-data-publish-nbirth: new metrics need a birth
            yield from self.birth(health)
            return
        now = _now()
        changed = {name: (value, now) for name, (_, value) in found.items()}
        types = {name: spec.type for name, (spec, _) in found.items()}
        yield from self._changes("NDATA", None, changed, False, types)
        answering = self._answering(health)
        for loop in sorted(self._born.difference(answering)):
            self._born.discard(loop)
            yield self._outgoing("DDEATH", loop, ())
        for loop in answering:
            if loop not in self._born:
                yield self._loop_birth(loop)

    def find_metric(self, loop: str | None, metric: Metric) -> str | None:
        """Return the name of a metric that a command gives by name or by alias."""
        if metric.name is not None:
            return metric.name
        for (owner, name), alias in self._aliases.items():
            if owner == (loop or "") and alias == metric.alias:
                return name
        return None

    def find_loop(self, topic: str) -> str | None:
        """Return the loop of a device command's topic; None for the node's or an unknown one."""
        prefix = f"{self.topic('DCMD')}/"
        level = topic.removeprefix(prefix)
        return next(
            (loop for loop in self._board if topic != level and as_level(loop) == level), None
        )

    def _of_node(self, message: Message) -> Iterator[tuple[str, tuple[Value, int]]]:
        yield "Event/Source", (message.source, message.utc_ms)
        for name, value in values_of(message):
            if name != MESSAGE_ID:
                yield name, (value, message.utc_ms)

    def _answering(self, health: Mapping[str, object]) -> list[str]:
        loops = health.get("loops")
        assert isinstance(loops, Mapping)
        return [loop for loop in self._board if loops.get(loop) in ("good", "degraded")]

    def _loop_birth(self, loop: str) -> Outgoing:
        now = _now()
        metrics = []
        for spec in self._specs:
            empty: Value = False if spec.name == "Command/Estimate Now" else None
            value, utc_ms = self._board[loop].get(spec.name, (empty, now))
            metrics.append(self._in_birth(loop, spec, value, utc_ms))
        self._born.add(loop)
        self._historical_until = max(self._historical_until, self._newest)
        return self._outgoing("DBIRTH", loop, metrics)

    def _in_birth(self, owner: str, spec: MetricSpec, value: Value, utc_ms: int) -> Metric:
        key = (owner, spec.name)
        alias = self._aliases.setdefault(key, len(self._aliases) + NODE_ALIASES)
        self._sent[key] = value
        return Metric(spec.name, alias, spec.type, value, utc_ms)

    def _changes(
        self,
        verb: str,
        loop: str | None,
        values: Mapping[str, tuple[Value, int]],
        historical: bool,
        types: Mapping[str, DataType] | None = None,
    ) -> Iterator[Outgoing]:
        owner = loop or ""
        node_types = {spec.name: spec.type for spec in self._events}
        known = types or (node_types if loop is None else self._type_of)
        metrics = []
        for name, (value, at) in values.items():
            key = (owner, name)
            if not historical:
                if self._sent.get(key) == value and key in self._sent:
                    continue
                self._sent[key] = value
            metrics.append(
                Metric(None, self._aliases[key], None, value, at, historical, known[name])
            )
        # A new number alone is not news: it comes with the next change.
        if metrics and (historical or [m.alias for m in metrics] != [self._number_of(owner)]):
            yield self._outgoing(verb, loop, metrics)

    def _number_of(self, owner: str) -> int | None:
        return self._aliases.get((owner, MESSAGE_ID))

    def _outgoing(self, verb: str, loop: str | None, metrics: Iterable[Metric]) -> Outgoing:
        seq = (self._seq + 1) % SEQUENCE
        data = encode(Payload(tuple(metrics), _now(), seq))
        # not before: what cannot be encoded is not sent, and must leave no gap
        self._seq = seq
        return Outgoing(self.topic(verb, loop), data, qos=0)
