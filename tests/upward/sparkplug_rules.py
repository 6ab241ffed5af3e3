"""Holds what an edge node sent against the numbered requirements of Sparkplug 3.0.

Payloads are taken apart by protobuf's wire format (varint, 64-bit, length, 32-bit) with the field
numbers of the specification; nothing here is shared with the code under test.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from tests.upward.wiretap import CONNECT, PUBLISH, SUBSCRIBE, Connection, Packet

DATA_TYPES = {1: 10, 2: 10, 3: 10, 4: 11, 5: 10, 6: 10, 7: 10, 8: 11, 9: 12, 10: 13, 11: 14, 12: 15}
"""Data type to the field that carries its value (section 6.4)."""


@dataclass(frozen=True)
class Metric:
    name: str | None
    alias: int | None
    timestamp: int | None
    datatype: int | None
    historical: bool
    null: bool
    field: int | None
    value: object


@dataclass(frozen=True)
class Payload:
    timestamp: int | None
    seq: int | None
    metrics: tuple[Metric, ...]


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at


def _fields(data: bytes) -> Iterator[tuple[int, object]]:
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        number, wire = key >> 3, key & 7
        if wire == 0:
            value: object
            value, at = _varint(data, at)
        elif wire == 1:
            value, at = struct.unpack("<d", data[at : at + 8])[0], at + 8
        elif wire == 2:
            size, at = _varint(data, at)
            value, at = data[at : at + size], at + size
        else:
            assert wire == 5
            value, at = struct.unpack("<f", data[at : at + 4])[0], at + 4
        yield number, value


def read_payload(data: bytes) -> Payload:
    found = list(_fields(data))
    single = dict(found)
    metrics = tuple(_metric(value) for number, value in found if number == 2)  # type: ignore[arg-type]
    return Payload(single.get(1), single.get(3), metrics)  # type: ignore[arg-type]


def _metric(data: bytes) -> Metric:
    found = dict(_fields(data))
    carrier = next((number for number in found if 10 <= number <= 19), None)
    value = None if carrier is None else found[carrier]
    name = found.get(1)
    return Metric(
        name=None if name is None else name.decode(),  # type: ignore[attr-defined]
        alias=found.get(2),  # type: ignore[arg-type]
        timestamp=found.get(3),  # type: ignore[arg-type]
        datatype=found.get(4),  # type: ignore[arg-type]
        historical=bool(found.get(5)),
        null=bool(found.get(7)),
        field=carrier,
        value=value.decode() if isinstance(value, bytes) else value,
    )


@dataclass
class _Session:
    bdseq: object = None
    seq: int | None = None
    is_born: bool = False
    devices: set[str] = field(default_factory=set)
    aliases: dict[int, tuple[str, int]] = field(default_factory=dict)
    values: dict[tuple[str, int], object] = field(default_factory=dict)


def violations(connections: Sequence[Connection], group: str, node: str) -> list[str]:
    """Return every requirement that is not met, with what was found."""
    found: list[str] = []
    before: object = None
    for connection in connections:
        session = _Session()
        if not connection.sent:
            continue
        found += _check_connect(connection.sent[0], session, before, group, node)
        before = session.bdseq
        subscribed = False
        for packet in connection.sent[1:]:
            if packet.kind == SUBSCRIBE:
                wanted = {
                    (f"spBv1.0/{group}/NCMD/{node}", 1),
                    (f"spBv1.0/{group}/DCMD/{node}/#", 1),
                }
                if not wanted <= set(packet.topics):
                    found.append("tck-id-message-flow-edge-node-birth-publish-subscribe")
                subscribed = True
            elif packet.kind == PUBLISH:
                if not subscribed:
                    found.append("tck-id-message-flow-edge-node-birth-publish-subscribe: too late")
                found += _check_publish(packet, session, group, node)
    return found


def _check_connect(
    packet: Packet, session: _Session, before: object, group: str, node: str
) -> Iterator[str]:
    if packet.kind != CONNECT or not packet.clean:
        yield "tck-id-message-flow-edge-node-birth-publish-connect"
    if packet.topic != f"spBv1.0/{group}/NDEATH/{node}":
        yield "tck-id-message-flow-edge-node-birth-publish-will-message-topic"
    if packet.qos != 1:
        yield "tck-id-message-flow-edge-node-birth-publish-will-message-qos"
    if packet.retain:
        yield "tck-id-message-flow-edge-node-birth-publish-will-message-will-retained"
    yield from _check_death(packet)
    metrics = read_payload(packet.payload).metrics
    session.bdseq = metrics[0].value if metrics else None
    if isinstance(before, int) and session.bdseq != (before + 1) % 256:
        yield f"tck-id-topics-nbirth-bdseq-increment: {session.bdseq} after {before}"


def _check_death(packet: Packet) -> Iterator[str]:
    payload = read_payload(packet.payload)
    if payload.seq is not None:
        yield "tck-id-topics-ndeath-seq"
    if [metric.name for metric in payload.metrics] != ["bdSeq"]:
        yield "tck-id-topics-ndeath-payload"


def _check_publish(packet: Packet, session: _Session, group: str, node: str) -> Iterator[str]:
    parts = packet.topic.split("/")
    if parts[:2] != ["spBv1.0", group] or len(parts) < 4 or parts[3] != node:
        yield f"tck-id-topic-structure: {packet.topic}"
        return
    verb, device = parts[2], parts[4] if len(parts) > 4 else ""
    if packet.retain:
        yield f"tck-id-topics-{verb.lower()}-mqtt: retained"
    payload = read_payload(packet.payload)
    if verb == "NDEATH":
        yield from _check_death(packet)
        if payload.metrics[0].value != session.bdseq:
            yield "tck-id-topics-ndeath-payload: bdSeq of another session"
        return
    if packet.qos != 0:
        yield f"tck-id-topics-{verb.lower()}-mqtt: QoS {packet.qos}"
    if payload.timestamp is None:
        yield f"tck-id-topics-{verb.lower()}-timestamp"
    yield from _check_sequence(verb, payload, session)
    if verb == "NBIRTH":
        session.is_born = True
        session.devices.clear()
        session.aliases.clear()
        session.values.clear()
        yield from _check_node_birth(payload, session)
    elif not session.is_born:
        yield f"tck-id-message-flow-edge-node-birth-publish-nbirth: {verb} before NBIRTH"
    if verb == "DBIRTH":
        session.devices.add(device)
    elif verb in ("DDATA", "DDEATH") and device not in session.devices:
        yield f"tck-id-message-flow-device-birth-publish: {verb} of {device} without DBIRTH"
    if verb == "DDEATH":
        session.devices.discard(device)
    if verb in ("NBIRTH", "DBIRTH"):
        yield from _check_birth_metrics(verb, device, payload, session)
    elif verb in ("NDATA", "DDATA"):
        yield from _check_data_metrics(verb, device, payload, session)


def _check_sequence(verb: str, payload: Payload, session: _Session) -> Iterator[str]:
    if payload.seq is None or not 0 <= payload.seq <= 255:
        yield f"tck-id-payloads-sequence-num-always-included: {verb}"
        return
    wanted = 0 if verb == "NBIRTH" or session.seq is None else (session.seq + 1) % 256
    if payload.seq != wanted:
        yield f"tck-id-payloads-sequence-num-incrementing: {verb} {payload.seq}, not {wanted}"
    session.seq = payload.seq


def _check_node_birth(payload: Payload, session: _Session) -> Iterator[str]:
    named = {metric.name: metric for metric in payload.metrics}
    rebirth, bdseq = named.get("Node Control/Rebirth"), named.get("bdSeq")
    if rebirth is None or rebirth.datatype != 11 or rebirth.value != 0:
        yield "tck-id-operational-behavior-data-commands-rebirth-value"
    elif rebirth.alias is not None:
        yield "tck-id-operational-behavior-data-commands-rebirth-name-aliases"
    if bdseq is None or bdseq.value != session.bdseq:
        yield "tck-id-topics-nbirth-bdseq-matching"


def _check_birth_metrics(
    verb: str, device: str, payload: Payload, session: _Session
) -> Iterator[str]:
    for metric in payload.metrics:
        if metric.name is None or metric.datatype is None:
            yield f"tck-id-topics-{verb.lower()}-metrics: name or datatype missing"
            continue
        if metric.timestamp is None:
            yield f"tck-id-payloads-name-birth-data-requirement: {metric.name}"
        if metric.null == (metric.field is not None):
            yield f"tck-id-operational-behavior-data-publish-{verb.lower()}-values: {metric.name}"
        if metric.field not in (None, DATA_TYPES.get(metric.datatype)):
            yield f"tck-id-payloads-metric-datatype-value: {metric.name}"
        if metric.historical:
            yield f"a birth holds current values: {metric.name} is historical"
        if metric.alias is None:
            continue
        known = session.aliases.get(metric.alias)
        if known is not None and known != (f"{device}/{metric.name}", metric.datatype):
            yield f"tck-id-payloads-alias-uniqueness: {metric.alias} of {metric.name} and {known}"
        session.aliases[metric.alias] = (f"{device}/{metric.name}", metric.datatype)
        session.values[device, metric.alias] = metric.value


def _check_data_metrics(
    verb: str, device: str, payload: Payload, session: _Session
) -> Iterator[str]:
    if not payload.metrics:
        yield f"tck-id-topics-{verb.lower()}-payload: empty"
    newest = 0
    for metric in payload.metrics:
        known = None if metric.alias is None else session.aliases.get(metric.alias)
        if known is None or not known[0].startswith(f"{device}/"):
            yield f"tck-id-operational-behavior-data-publish-{verb[0].lower()}birth: {metric}"
            continue
        if metric.name is not None:
            yield f"tck-id-payloads-alias-data-cmd-requirement: {metric.name}"
        if metric.timestamp is None:
            yield f"tck-id-payloads-name-birth-data-requirement: {known}"
        if metric.field not in (None, DATA_TYPES[known[1]]):
            yield f"tck-id-payloads-metric-datatype-value: {known}"
        if metric.historical:
            continue
        if (metric.timestamp or 0) < newest:
            yield f"tck-id-operational-behavior-data-publish-{verb.lower()}-order: {known}"
        newest = metric.timestamp or 0
        key = (device, metric.alias or 0)
        if session.values.get(key, "none") == metric.value:
            yield f"tck-id-operational-behavior-data-publish-{verb.lower()}-change: {known}"
        session.values[key] = metric.value
