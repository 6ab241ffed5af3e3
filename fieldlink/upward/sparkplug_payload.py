"""The Sparkplug B payload as a protobuf message.

The message is declared here in the field numbers of the specification (Sparkplug 3.0, section 6.4),
reduced to what an edge node of numbers and texts needs; what others add is skipped while reading,
as protobuf provides. So no generated code and no fixed protobuf release is carried along.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

__all__ = ["DataType", "Metric", "Payload", "PayloadError", "Value", "decode", "encode"]

Value = int | float | bool | str | None


class PayloadError(ValueError):
    """Bytes that are not a Sparkplug B payload."""


class DataType(IntEnum):
    """The data types used here, with the specification's indexes."""

    INT32 = 3
    INT64 = 4
    DOUBLE = 10
    BOOLEAN = 11
    STRING = 12


_FIELD_OF = {
    DataType.INT32: "int_value",
    DataType.INT64: "long_value",
    DataType.DOUBLE: "double_value",
    DataType.BOOLEAN: "boolean_value",
    DataType.STRING: "string_value",
}


_BITS = {DataType.INT32: 32, DataType.INT64: 64}


@dataclass(frozen=True, slots=True)
class Metric:
    """One metric of a payload.

    Attributes:
        name: None in data messages, which have the alias only.
        alias: None where the metric has none.
        type: its data type; None in data messages.
        value: None stands for null.
        utc_ms: when the value was taken.
        historical: whether the value is older than the birth.
    """

    name: str | None
    alias: int | None
    type: DataType | None
    value: Value
    utc_ms: int | None
    historical: bool = False
    value_type: DataType | None = None

    @property
    def encoded_as(self) -> DataType:
        """The type that decides which field of the message carries the value."""
        found = self.type or self.value_type
        assert found is not None, "a metric needs a type to be encoded"
        return found


@dataclass(frozen=True, slots=True)
class Payload:
    """A payload: metrics, the time of sending, and the sequence number where there is one."""

    metrics: tuple[Metric, ...]
    utc_ms: int | None
    seq: int | None


def encode(payload: Payload) -> bytes:
    """Return a payload as bytes."""
    message = _message_class()()
    if payload.utc_ms is not None:
        message.timestamp = payload.utc_ms
    if payload.seq is not None:
        message.seq = payload.seq
    for metric in payload.metrics:
        entry = message.metrics.add()
        if metric.name is not None:
            entry.name = metric.name
        if metric.alias is not None:
            entry.alias = metric.alias
        if metric.utc_ms is not None:
            entry.timestamp = metric.utc_ms
        if metric.type is not None:
            entry.datatype = int(metric.type)
        if metric.historical:
            entry.is_historical = True
        if metric.value is None:
            entry.is_null = True
        else:
            setattr(entry, _FIELD_OF[metric.encoded_as], _encoded(metric))
    return bytes(message.SerializeToString())


def _encoded(metric: Metric) -> Value:
    """A metric's value; a negative number as its two's complement (Sparkplug 3.0, 6.4.16)."""
    bits = _BITS.get(metric.encoded_as)
    return metric.value if bits is None else int(metric.value or 0) & ((1 << bits) - 1)


def decode(data: bytes) -> Payload:
    """Return bytes as a payload; values of kinds that are not used here become None.

    Raises:
        PayloadError: they are none.
    """
    message = _message_class()()
    try:
        message.ParseFromString(data)
    except DecodeError as error:
        raise PayloadError(str(error)) from error
    return Payload(
        tuple(_decoded(entry) for entry in message.metrics),
        message.timestamp if message.HasField("timestamp") else None,
        message.seq if message.HasField("seq") else None,
    )


def _decoded(entry: Any) -> Metric:
    known = {int(kind): kind for kind in DataType}
    field = entry.WhichOneof("value")
    value = getattr(entry, field) if field in _FIELD_OF.values() else None
    return Metric(
        name=entry.name if entry.HasField("name") else None,
        alias=entry.alias if entry.HasField("alias") else None,
        type=known.get(entry.datatype) if entry.HasField("datatype") else None,
        value=value,
        utc_ms=entry.timestamp if entry.HasField("timestamp") else None,
        historical=entry.is_historical,
    )


_KIND = descriptor_pb2.FieldDescriptorProto
_METRIC_FIELDS = (
    ("name", 1, _KIND.TYPE_STRING),
    ("alias", 2, _KIND.TYPE_UINT64),
    ("timestamp", 3, _KIND.TYPE_UINT64),
    ("datatype", 4, _KIND.TYPE_UINT32),
    ("is_historical", 5, _KIND.TYPE_BOOL),
    ("is_transient", 6, _KIND.TYPE_BOOL),
    ("is_null", 7, _KIND.TYPE_BOOL),
)
_VALUE_FIELDS = (
    ("int_value", 10, _KIND.TYPE_UINT32),
    ("long_value", 11, _KIND.TYPE_UINT64),
    ("float_value", 12, _KIND.TYPE_FLOAT),
    ("double_value", 13, _KIND.TYPE_DOUBLE),
    ("boolean_value", 14, _KIND.TYPE_BOOL),
    ("string_value", 15, _KIND.TYPE_STRING),
    ("bytes_value", 16, _KIND.TYPE_BYTES),
)


@cache
def _message_class() -> Any:
    file = descriptor_pb2.FileDescriptorProto(
        name="fieldlink/sparkplug_b.proto", package="fieldlink.sparkplug", syntax="proto2"
    )
    payload = file.message_type.add(name="Payload")
    metric = payload.nested_type.add(name="Metric")
    metric.oneof_decl.add(name="value")
    _add(metric, _METRIC_FIELDS)
    _add(metric, _VALUE_FIELDS, oneof_index=0)
    _add(payload, [("timestamp", 1, _KIND.TYPE_UINT64), ("seq", 3, _KIND.TYPE_UINT64)])
    payload.field.add(
        name="metrics",
        number=2,
        type=_KIND.TYPE_MESSAGE,
        label=_KIND.LABEL_REPEATED,
        type_name=".fieldlink.sparkplug.Payload.Metric",
    )
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(file.SerializeToString())
    found = pool.FindMessageTypeByName("fieldlink.sparkplug.Payload")
    return message_factory.GetMessageClass(found)


def _add(message: Any, fields: Iterable[tuple[str, int, int]], **more: int) -> None:
    for name, number, kind in fields:
        message.field.add(name=name, number=number, type=kind, label=_KIND.LABEL_OPTIONAL, **more)
