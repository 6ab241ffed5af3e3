"""Which metrics the edge node and its devices, the loops, have, and where their values are from."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import NamedTuple

from fieldlink.upward.messages import Message
from fieldlink.upward.sparkplug_payload import DataType, Value

__all__ = [
    "COMMAND_METRICS",
    "MESSAGE_ID",
    "NODE_EVENTS",
    "STREAM",
    "VERSION",
    "MetricSpec",
    "device_health",
    "loop_metrics",
    "values_of",
]


class MetricSpec(NamedTuple):
    """A metric: its name, its type, and the kind and key of the messages that carry it."""

    name: str
    type: DataType
    kind: str = ""
    key: str = ""


MESSAGE_ID = "Message/ID"
STREAM = MetricSpec("Message/Stream", DataType.STRING)
VERSION = MetricSpec("Properties/Version", DataType.STRING)

_NUMBER, _TEXT = DataType.DOUBLE, DataType.STRING

_ESTIMATE = (
    MetricSpec("Estimate/Outcome", _TEXT, "estimate", "outcome"),
    MetricSpec("Estimate/Message", _TEXT, "estimate", "message"),
    MetricSpec("Estimate/Verdict", _TEXT, "estimate", "verdict"),
    MetricSpec("Estimate/Score", _NUMBER, "estimate", "score"),
    MetricSpec("Estimate/Stick Band", _NUMBER, "estimate", "stick_band"),
    MetricSpec("Estimate/Stick Band Low", _NUMBER, "estimate", "stick_band_low"),
    MetricSpec("Estimate/Stick Band High", _NUMBER, "estimate", "stick_band_high"),
    MetricSpec("Estimate/Slip Jump", _NUMBER, "estimate", "slip_jump"),
    MetricSpec("Estimate/Slip Jump Low", _NUMBER, "estimate", "slip_jump_low"),
    MetricSpec("Estimate/Slip Jump High", _NUMBER, "estimate", "slip_jump_high"),
    MetricSpec("Estimate/Confidence", _NUMBER, "estimate", "confidence"),
    MetricSpec("Estimate/R2", _NUMBER, "estimate", "r2"),
)
_WRITEBACK = (
    MetricSpec("Block/Outcome", _TEXT, "writeback", "outcome"),
    MetricSpec("Block/Reason", _TEXT, "writeback", "reason"),
    MetricSpec("Block/Sequence", DataType.INT64, "writeback", "seq"),
    MetricSpec("Block/Status", _TEXT, "writeback", "status"),
)
_SAMPLE = (
    MetricSpec("Sample/OP", _NUMBER, "sample", "op"),
    MetricSpec("Sample/PV", _NUMBER, "sample", "pv"),
    MetricSpec("Sample/SP", _NUMBER, "sample", "sp"),
    MetricSpec("Sample/Auto", DataType.BOOLEAN, "sample", "auto"),
    MetricSpec("Sample/Quality", DataType.INT32, "sample", "quality"),
)
_EVENT = (
    MetricSpec("Event/Kind", _TEXT, "event", "kind"),
    MetricSpec("Event/Message", _TEXT, "event", "message"),
)
_FINDING = (
    MetricSpec("Finding/ID", _TEXT, "finding", "finding"),
    MetricSpec("Finding/State", _TEXT, "finding", "state"),
    MetricSpec("Finding/Cause", _TEXT, "finding", "cause"),
    MetricSpec("Finding/Weight", _NUMBER, "finding", "weight"),
    MetricSpec("Finding/Period", _NUMBER, "finding", "swing_period_s"),
    MetricSpec("Finding/Message", _TEXT, "finding", "message"),
)
_GROUPS: Mapping[str, tuple[MetricSpec, ...]] = {
    "estimates": _ESTIMATE,
    "writebacks": _WRITEBACK,
    "samples": _SAMPLE,
    "events": _EVENT,
    "findings": _FINDING,
}
_OF_KIND = {
    kind: [spec for group in _GROUPS.values() for spec in group if spec.kind == kind]
    for kind in ("estimate", "writeback", "sample", "event", "finding")
}

NODE_EVENTS = (MetricSpec("Event/Source", _TEXT, "event", ""), *_EVENT)
"""The newest event that is about a device or the daemon."""

COMMAND_METRICS = {
    "estimate_now": MetricSpec("Command/Estimate Now", DataType.BOOLEAN),
    "withdraw": MetricSpec("Command/Withdraw", DataType.STRING),
}
"""A command is given by writing the reason (withdraw) or true."""


def loop_metrics(publish: Collection[str], commands: Collection[str]) -> list[MetricSpec]:
    """Return the metrics of a loop."""
    found = [MetricSpec(MESSAGE_ID, DataType.INT64)]
    for word, group in _GROUPS.items():
        if word in publish:
            found.extend(group)
    found.extend(COMMAND_METRICS[command] for command in commands)
    return found


def values_of(message: Message) -> Iterator[tuple[str, Value]]:
    """Yield the metrics that a message carries, by name."""
    yield MESSAGE_ID, message.id
    for spec in _OF_KIND[message.kind]:
        value = message.body.get(spec.key)
        if isinstance(value, str | bool) or value is None:
            yield spec.name, value
        elif isinstance(value, int | float):
            yield spec.name, float(value) if spec.type is DataType.DOUBLE else int(value)


def device_health(health: Mapping[str, object]) -> Iterator[tuple[MetricSpec, Value]]:
    """Yield the node's metrics about its devices and the store."""
    devices = health.get("devices")
    assert isinstance(devices, list)
    for device in devices:
        name = str(device["name"])
        yield MetricSpec(f"Devices/{name}/State", _TEXT), str(device["state"])
        yield MetricSpec(f"Devices/{name}/Reason", _TEXT), str(device["reason"])
        yield MetricSpec(f"Devices/{name}/Missed", DataType.INT64), int(device["missed"])
    yield MetricSpec("Store/Failing", DataType.BOOLEAN), bool(health.get("store_failing"))
