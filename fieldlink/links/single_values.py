"""Reading and writing single values by hand: for commissioning, not for the daemon.

What may be written is what the register map allows: a tag that is writable, a value inside its
range. A write is never repeated, and what the device holds afterwards is read back.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

from fieldlink.errors import FieldlinkError
from fieldlink.links.base import Link, Reading, Scan
from fieldlink.links.clock import SystemClock
from fieldlink.links.errors import (
    AccessRefusedError,
    ExceptionCode,
    ExceptionReplyError,
    LinkError,
)
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.links.registry import open_link
from fieldlink.printable import quoted
from fieldlink.registers import DataType, RegisterValueError, Table, Tag, plan_reads
from fieldlink.site import Device, Site
from fieldlink.whole_numbers import whole_number

__all__ = [
    "ByHandError",
    "Point",
    "as_manual_address",
    "is_held",
    "parse_point",
    "read_points",
    "scan_points",
    "words_for",
    "write_point",
]


_UNSETTLED = frozenset(
    {
        ExceptionCode.DEVICE_FAILURE,
        ExceptionCode.ACKNOWLEDGE,
        ExceptionCode.GATEWAY_TARGET,
        ExceptionCode.UNKNOWN,
    }
)
"""Answers to a write that leave open whether it was or will be carried out; the others refuse it
(Modbus application protocol V1.1b3, section 7)."""


class ByHandError(FieldlinkError):
    """What was asked for is neither a tag nor an address, or not a value."""


@dataclass(frozen=True, slots=True)
class Point:
    """A value of a device.

    Attributes:
        name: the device's name.
        device: the device.
        tag: where the value is and what it means.
        site: the site it is from; None for an address of a host.
    """

    name: str
    device: Device
    tag: Tag
    site: Site | None = None

    @property
    def where(self) -> str:
        """The place as people write it: table, registers, device."""
        tag = self.tag
        if tag.node:
            return f"{tag.node} of {self.name} ({self.device.where})"
        last = f" to {tag.end - 1}" if tag.count > 1 else ""
        place = self.device.where
        # A host is its own name.
        named = place if place.startswith(self.name) else f"{self.name} ({place})"
        return f"{tag.table} {tag.address}{last} of {named}"


WHOLE_UP_TO = 2**53
"""A float64, as which values are computed, holds every whole number up to here."""

_MANUAL = re.compile(r"([0134])(\d{4,5})")
_MANUAL_TABLES = {"0": Table.COIL, "1": Table.DISCRETE, "3": Table.INPUT, "4": Table.HOLDING}


def as_manual_address(text: str) -> str | None:
    """Return the point that manuals write as ``text``: 40001 is holding:0; None for any other.

    Only five or six digits without a table are written so: a table says what is meant. A type does
    not: 40001:float32 is holding:0:float32.
    """
    number, colon, kind = text.partition(":")
    found = _MANUAL.fullmatch(number)
    if found is None or not 1 <= int(found[2]) <= 0x10000:
        return None
    table = _MANUAL_TABLES[found[1]]
    if colon and table.is_bits:
        return None
    return f"{table}:{int(found[2]) - 1}{colon}{kind}"


def parse_point(text: str, device: Device) -> Tag:
    """Return the tag that ``[table:]address[:type[:length]]`` describes, such as ``input:7``.

    Raises:
        ByHandError: it describes none.
    """
    if device.is_opcua:
        raise ByHandError(
            f"{text!r} is not a tag of an OPC UA device; add its node to the node map"
        )
    parts = text.split(":")
    table = Table.HOLDING
    if parts[0] in list(Table):
        table = Table(parts.pop(0))
    default = DataType.BOOL if table.is_bits else DataType.UINT16
    number, kind, length, *rest = (*parts, *("",) * (3 - len(parts)))
    usage = "write [table:]address[:type[:length]], such as 7, input:7 or holding:100:float32"
    manual = as_manual_address(number)
    if manual is not None and int(number) > 0xFFFF:
        raise ByHandError(f"{quoted(text)} is how manuals write {manual}; give {manual}")
    address = whole_number(number, 0xFFFF)
    if address is None or rest:
        raise ByHandError(f"{quoted(text)} is neither a tag nor an address; {usage}")
    if kind and kind not in list(DataType):
        raise ByHandError(f"{text!r}: {kind!r} is not a type; use one of: {', '.join(DataType)}")
    data_type = DataType(kind) if kind else default
    if length and not (data_type is DataType.STRING and whole_number(length, 0xFFFF) is not None):
        raise ByHandError(f"{quoted(text)}: only a string has a length, a whole number; {usage}")
    if (data_type is DataType.STRING) != bool(length):
        raise ByHandError(f"{text!r}: a string needs its registers, such as holding:100:string:8")
    if table.is_bits and data_type is not DataType.BOOL:
        raise ByHandError(f"{text!r}: a {table} is one bit; leave the type out")
    tag = Tag(
        text,
        table,
        address,
        data_type,
        writable=table.is_writable,
        length=int(length or 0),
        word_order=device.word_order,
        byte_order=device.byte_order,
    )
    if tag.end > 0x10000:
        raise ByHandError(
            f"{text!r}: its {tag.count} registers would end at {tag.end - 1}, the last address is "
            "65535; give another address or type"
        )
    return tag


async def read_points(points: Sequence[Point]) -> list[Reading]:
    """Read points of one device once; one that it refuses has a reading that says so.

    Raises:
        LinkError: the device gave none of them.
    """
    scan = await scan_points(points)
    return [scan[point.tag.name] for point in points]


async def scan_points(points: Sequence[Point]) -> Scan:
    """Read points of one device once, as `read_points` does; with the errors behind bad readings.

    Raises:
        LinkError: the device gave none of them.
    """
    link = _reader(points[0], [point.tag for point in points])
    try:
        scan = await link.scan()
    finally:
        await link.close()
    if scan.failures and not any(scan[point.tag.name].was_read for point in points):
        raise scan.failures[0]
    return scan


def words_for(point: Point, text: str) -> list[int]:
    """Return the words, or the bit, that write ``text`` to a point.

    Raises:
        AccessRefusedError: the register map does not let it be written.
        ByHandError: ``text`` is not a value of its type.
        RegisterValueError: the value is outside the range or does not fit the type.
    """
    tag = point.tag
    if not tag.table.is_writable:
        raise AccessRefusedError(
            point.name,
            f"{tag.name} is in the table {tag.table}, which Modbus cannot write",
            "choose a holding register or a coil",
        )
    if not tag.writable:
        raise AccessRefusedError(
            point.name,
            f"{tag.name} is not writable in the register map",
            "write yes in its column writable, if that is meant",
        )
    if tag.data_type is DataType.STRING:
        return tag.encode_text(text)
    states = {"true": 1.0, "on": 1.0, "false": 0.0, "off": 0.0}
    try:
        value = states[text.lower()] if text.lower() in states else float(text)
    except ValueError as error:
        raise ByHandError(
            f"{text!r} is not a value for {tag.name} ({tag.data_type}); give a number such as 45.5"
            + (", true or false" if tag.data_type is DataType.BOOL else "")
        ) from error
    if not math.isfinite(value):
        raise RegisterValueError(f"{tag.name}: {text} is not a measured value; give a number")
    holds_whole = not tag.data_type.is_float and tag.data_type is not DataType.BOOL
    if holds_whole and (tag.scale, tag.offset) == (1.0, 0.0) and value % 1.0:
        raise RegisterValueError(
            f"{tag.name}: {text} would be written as {round(value)}, for {tag.data_type} holds "
            f"whole numbers; give {round(value)} if that will do"
        )
    is_whole = holds_whole and abs(value) >= WHOLE_UP_TO
    if is_whole and Decimal(text) != Decimal(value):
        raise RegisterValueError(
            f"{tag.name}: {text} would be written as {int(value)}; whole numbers are exact up to "
            f"{WHOLE_UP_TO}, so give {int(value)} if that will do"
        )
    return tag.encode(value)


async def write_point(point: Point, words: Sequence[int]) -> Reading:
    """Write a point once and return what the device holds afterwards.

    Raises:
        LinkError: it was not confirmed, or could not be read back; says whether it was written.
    """
    tag = point.tag
    link = _link(point, [tag])
    try:
        await _write(link, tag, words)
        scan = await link.scan()
    finally:
        await link.close()
    if scan.failures:
        failure = scan.failures[0]
        raise LinkError(
            failure.device,
            f"the write was confirmed, but reading it back failed: {failure.what}",
            "read the value again; the write is not repeated",
        ) from failure
    return scan[tag.name]


def is_held(tag: Tag, words: Sequence[int], after: Reading) -> bool:
    """Return whether a reading shows what ``words`` have written to a tag."""
    meant = tag.judge(float(words[0])) if tag.table.is_bits else tag.decode(words)
    if meant.text is not None:
        return after.text == meant.text
    return after.good == meant.quality.is_good and (not after.good or after.value == meant.value)


async def _write(link: ModbusLink, tag: Tag, words: Sequence[int]) -> None:
    try:
        if tag.table is Table.COIL:
            await link.write_coils(tag.address, words)
        elif len(words) == 1:
            await link.write_register(tag.address, words[0])
        else:
            await link.write_registers(tag.address, words)
    except LinkError as error:
        refused = isinstance(error, ExceptionReplyError) and error.code not in _UNSETTLED
        if refused or not link.requests:
            raise
        remedy = "the write may have been carried out: read the value before you write again"
        raise LinkError(error.device, error.what, remedy) from error


def _reader(point: Point, tags: Sequence[Tag]) -> Link:
    if not point.device.is_opcua or point.site is None:
        return _link(point, tags)
    asked = point.device.opcua.model_copy(update={"mode": "read"})
    site = point.site.with_device(point.name, opcua=asked)
    return open_link(site, point.name)


def _link(point: Point, tags: Sequence[Tag]) -> ModbusLink:
    device = point.device
    coil = point.tag.table is Table.COIL
    span = ((point.tag.address, point.tag.end - 1),)
    plan = plan_reads(
        tags,
        device.max_gap,
        device.max_registers,
        device.ranges,
        one_tag=device.quirks.one_request_per_tag,
    )
    settings = ModbusSettings(
        point.name,
        device,
        site=point.site,
        writable=() if coil else span,
        writable_coils=span if coil else (),
    )
    return ModbusLink(settings, plan, SystemClock())
