"""Plain JSON on readable topics: ``fieldlink/SITE/AREA/LOOP/estimate`` and the like.

QoS 1. Estimates, write-backs, open findings, health and ``online`` are retained, so that a
dashboard that starts later shows them at once. A finding may stand for months without another
message, so it is sent again with each connection: a broker that was started anew may have forgotten
it, and the message may have been dropped in a long outage. Every message carries ``stream`` and
``id``: a consumer that keeps the highest id of a stream can drop repeats.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime

from fieldlink.site import Site
from fieldlink.upward.commands import CommandDesk
from fieldlink.upward.formats import Health
from fieldlink.upward.messages import LEFT, Message
from fieldlink.upward.packets import LONGEST_TOPIC, Incoming, Outgoing
from fieldlink.upward.topics import JsonTopics

__all__ = ["JsonFormat"]

_RETAINED = {"estimates": "estimate", "writebacks": "writeback"}
"""Kinds of which the broker keeps a loop's newest, by the word in the site file."""
_MOST_CLOSED = 100
"""Closed findings that are told again, so that the broker forgets them: more than close in an
outage that drops messages."""


class JsonFormat:
    """The JSON format of a site.

    Args:
        site: the site.
        desk: takes the commands.
    """

    name = "json"
    confirms = True

    def __init__(self, site: Site, desk: CommandDesk) -> None:
        self._desk = desk
        self._last_health = ""
        self._findings: dict[str, Message] = {}
        self._stream = ""
        self.follow(site, "")

    def follow(self, site: Site, stream: str) -> None:
        """Take a site's loops and names."""
        assert site.file.mqtt is not None
        if stream != self._stream:
            # Their numbers are those of the stream before.
            self._findings = {}
        self._site, self._stream = site, stream
        self._topics = JsonTopics(site)
        self._takes_commands = bool(site.file.mqtt.commands)
        self._tells_health = "health" in site.file.mqtt.publish

    @property
    def retained(self) -> Sequence[str]:
        """Topics of the site on which the broker keeps what this format sends."""
        assert self._site.file.mqtt is not None
        published = self._site.file.mqtt.publish
        kinds = [kind for word, kind in _RETAINED.items() if word in published]
        topics = [f"{topic}/{kind}" for topic in self._topics.loops.values() for kind in kinds]
        return [*topics, *([self._topics.health] if self._tells_health else [])]

    def note(self, message: Message) -> None:
        """Keep the newest message of a finding, to be sent again with the next connection."""
        if message.kind != "finding":
            return
        name = str(message.body["finding"])
        self._findings.pop(name, None)
        self._findings[name] = message
        closed = [name for name, one in self._findings.items() if not _is_open(one)]
        if len(closed) > _MOST_CLOSED:
            del self._findings[closed[0]]

    def repeats(self, before: int) -> Iterable[Outgoing]:
        """Return the findings, the oldest first; closed ones once."""
        told = {name: one for name, one in self._findings.items() if one.id < before}
        for name, one in told.items():
            if not _is_open(one):
                del self._findings[name]
        return [packet for one in told.values() for packet in self.encode(one)]

    def forget_repeats(self) -> None:
        """Repeat nothing that was noted up to now."""
        self._findings = {}

    def will(self, birth: int) -> Outgoing:  # noqa: ARG002
        """Return ``online: false``, retained."""
        return self._online(False)

    def subscriptions(self) -> Sequence[str]:
        """Return the filter of the commands, where the site takes any."""
        return (self._topics.commands,) if self._takes_commands else ()

    def begin(self, health: Health) -> Iterable[Outgoing]:
        """Return ``online: true`` and the health."""
        self._last_health = ""
        return [self._online(True), *self.note_health(health)]

    def encode(self, message: Message) -> Iterable[Outgoing]:
        """Return the message as one JSON object."""
        document: dict[str, object] = {
            "stream": self._stream,
            "id": message.id,
            "site": self._site.name,
            "kind": message.kind,
            "time": _time_text(message.utc_ms),
        }
        if message.kind == "event":
            # An event's own kind (device.demoted) is what readers look for.
            document |= {"event": message.body["kind"], "source": message.source}
            rest = {key: value for key, value in message.body.items() if key != "kind"}
            return [_packet(self._topics.events, document | rest)]
        if message.kind == "finding":
            return self._encode_finding(message, document)
        if message.kind == LEFT:
            return self._encode_left(message, document)
        topic = self._topics.of_kind(message.source, message.kind)
        if topic is None:
            # The loop has gone from the site file since: there is no topic left for it.
            return []
        loop = self._site.loops[message.source]
        document |= {"area": loop.area, "loop": message.source}
        retain = message.kind in _RETAINED.values()
        return [_packet(topic, document | dict(message.body), retain=retain)]

    def _encode_finding(
        self, message: Message, document: Mapping[str, object]
    ) -> Iterable[Outgoing]:
        """Return the finding, retained while it is open; a closed one leaves the broker."""
        topic = self._topics.finding(str(message.body["finding"]))
        is_open = _is_open(message)
        found = [_packet(topic, {**document, **message.body}, retain=is_open)]
        if not is_open:
            # MQTT 5, 3.3.1.3: an empty retained message removes the one before
            found.append(Outgoing(topic, b"", qos=1, retain=True))
        return found

    def _encode_left(self, message: Message, document: Mapping[str, object]) -> Iterable[Outgoing]:
        """Return what makes the broker forget topics; their names go to the events' topic."""
        topics = message.body["topics"]
        assert isinstance(topics, list)
        told = _packet(self._topics.events, {**document, "topics": topics})
        # One of them may be in use again since: a dashboard must not lose what is there now.
        gone = set(topics).difference(self.retained)
        return [told, *(Outgoing(topic, b"", qos=1, retain=True) for topic in sorted(gone))]

    def note_health(self, health: Health) -> Iterable[Outgoing]:
        """Return the health when it has changed."""
        told = json.dumps(health)
        if not self._tells_health or told == self._last_health:
            return []
        self._last_health = told
        document = {"site": self._site.name, "time": _time_text(None), **health}
        return [_packet(self._topics.health, document, retain=True)]

    def receive(self, incoming: Incoming, health: Health) -> Iterable[Outgoing]:  # noqa: ARG002
        """Carry out a command; the answer goes to its topic with ``/result`` added."""
        loop, command = self._topics.find_command(incoming.topic)
        request = {} if incoming.refusal else _read_request(incoming.payload)
        answer = self._desk.handle(
            command,
            loop,
            str(request.get("reason", "")),
            topic=incoming.topic,
            refusal=incoming.refusal,
        )
        topic = f"{incoming.topic}/result"
        if len(topic.encode()) > LONGEST_TOPIC:
            return []
        document = {
            "time": _time_text(None),
            "accepted": answer.accepted,
            "message": answer.message,
            "request": _repeatable(request.get("request")),
        }
        return [_packet(topic, document)]

    def farewell(self) -> Sequence[Outgoing]:
        """Return ``online: false``."""
        return (self._online(False),)

    def _online(self, online: bool) -> Outgoing:
        document = {"site": self._site.name, "online": online}
        return _packet(self._topics.online, document, retain=True)


def _is_open(finding: Message) -> bool:
    return finding.body["state"] != "closed"


def _packet(topic: str, document: Mapping[str, object], *, retain: bool = False) -> Outgoing:
    data = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
    return Outgoing(topic, data, qos=1, retain=retain)


def _read_request(payload: bytes) -> Mapping[str, object]:
    """Return a command's JSON object; plain text is taken as its reason."""
    text = payload.decode("utf-8", errors="replace").strip()
    try:
        found = json.loads(text) if text else {}
    except (ValueError, RecursionError):
        return {"reason": text}
    return found if isinstance(found, dict) else {"reason": text}


def _repeatable(value: object) -> object:
    """A sender's own mark as the answer repeats it; None where JSON in UTF-8 cannot hold it."""
    try:
        json.dumps(value, allow_nan=False, ensure_ascii=False).encode()
    except (ValueError, RecursionError):
        return None
    return value


def _time_text(utc_ms: int | None) -> str:
    moment = datetime.now(UTC) if utc_ms is None else datetime.fromtimestamp(utc_ms / 1000.0, UTC)
    return moment.isoformat(timespec="milliseconds")
