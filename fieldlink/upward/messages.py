"""From the daemon's records to messages: one neutral body that each format encodes its own way."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from fieldlink.store import (
    EstimateRecord,
    EventRecord,
    FindingRecord,
    Record,
    SampleRecord,
    WritebackRecord,
)

__all__ = ["LEFT", "Message", "message_maker"]

LEFT = "left"
"""Kind of a message about topics that the site has left, on which the broker keeps something."""

_KINDS: Mapping[type[Record], tuple[str, str]] = {
    SampleRecord: ("samples", "sample"),
    EstimateRecord: ("estimates", "estimate"),
    WritebackRecord: ("writebacks", "writeback"),
    EventRecord: ("events", "event"),
    FindingRecord: ("findings", "finding"),
}
"""The word in the site file's ``publish``, and the kind of the message."""

_LEFT_OUT = frozenset(
    {"loop", "source", "utc_ms", "words", "bank_before", "active_before", "clock_steps"}
)
"""Columns that the message has elsewhere, and raw registers, which only the historian keeps."""


@dataclass(frozen=True, slots=True)
class Message:
    """One thing to tell.

    Attributes:
        kind: sample, estimate, writeback, event, finding, or `LEFT`.
        source: the loop; for an event what it is about: a loop, a device or the daemon; for a
            finding whose source is none of its loops the first of them.
        utc_ms: when it happened, milliseconds since 1970.
        body: plain JSON types; what is missing or not finite is None.
        id: number in the spool, one more for each message; 0 before it is there.
    """

    kind: str
    source: str
    utc_ms: int
    body: Mapping[str, object]
    id: int = 0


def message_maker(publish: Collection[str]) -> Callable[[Record], Message | None]:
    """Return what makes messages of records, and None of what the site does not publish."""
    wanted = {record: kind for record, (word, kind) in _KINDS.items() if word in publish}

    def make(record: Record) -> Message | None:
        kind = wanted.get(type(record))
        if kind is None:
            return None
        row = record.row()
        source = str(row.get("loop", row.get("source", "")))
        body = {key: value for key, value in row.items() if key not in _LEFT_OUT}
        if isinstance(record, FindingRecord):
            body["candidate"] = record.loop or None
            source = record.loop or next(iter(record.loops), "")
        return Message(kind, source, int(str(row["utc_ms"])), body)

    return make
