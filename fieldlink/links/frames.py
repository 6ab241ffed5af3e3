"""Requests, the replies they may have, and the two framings of Modbus.

A reply is never searched for by what it might be: a request knows the length and the first bytes of
the only regular answer to it (function and byte count of a read, the echo of a write), and whatever
else arrives is not an answer. The sources are the Modbus application protocol (V1.1b3) and Modbus
over serial line (V1.02).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

from fieldlink.registers import Table, pack_payload
from fieldlink.registers.crc import crc16_bytes

__all__ = [
    "Frame",
    "Framing",
    "FramingError",
    "MbapFraming",
    "Request",
    "RtuFraming",
    "echo_request",
    "read_request",
    "write_coils_request",
    "write_many_request",
    "write_one_request",
]

EXCEPTION = 0x80
DIAGNOSTICS = 8
_READS, _ECHOES = (1, 2, 3, 4), (5, 6, DIAGNOSTICS, 15, 16)
_MBAP, _LONGEST_PDU = 7, 253


class FramingError(Exception):
    """Bytes that cannot belong to any frame; the text says why."""


@dataclass(frozen=True, slots=True)
class Request:
    """One request of a client.

    Attributes:
        pdu: function code and data.
        head: how the regular reply's PDU begins.
        size: bytes of the regular reply's PDU.
        table, address, count: what is asked for, for messages.
    """

    pdu: bytes
    head: bytes
    size: int
    table: Table = Table.HOLDING
    address: int = 0
    count: int = 0

    @property
    def text(self) -> str:
        """What is asked for, for messages."""
        if self.function == DIAGNOSTICS:
            return "asking for an echo"
        verb = "reading" if self.function in _READS else "writing"
        last = f" to {self.address + self.count - 1}" if self.count > 1 else ""
        return f"{verb} {self.table} {self.address}{last}"

    @property
    def function(self) -> int:
        """The function code."""
        return self.pdu[0]

    @property
    def bytes_on_line(self) -> int:
        """Bytes of the request and its regular reply as RTU frames: unit and CRC are three each."""
        return len(self.pdu) + self.size + 6

    @property
    def is_read(self) -> bool:
        """Whether the request changes nothing, so that it may be sent again."""
        return self.function in _READS

    def is_regular(self, pdu: bytes) -> bool:
        """Whether ``pdu`` is the regular answer."""
        return len(pdu) == self.size and pdu.startswith(self.head)

    def registers_of(self, pdu: bytes) -> int:
        """How many registers a well-formed answer to this read holds; 0 for any other answer.

        Some devices answer a read that is too long for them with as many as they can.
        """
        if not (self.is_read and not self.table.is_bits and len(pdu) > 2):
            return 0
        fits = pdu[0] == self.function and pdu[1] == len(pdu) - 2 and pdu[1] % 2 == 0
        return pdu[1] // 2 if fits else 0

    def is_exception(self, pdu: bytes) -> bool:
        """Whether ``pdu`` is an exception answer to this function."""
        return len(pdu) == 2 and pdu[0] == self.function | EXCEPTION


@lru_cache(maxsize=4096)
def read_request(table: Table, address: int, count: int) -> Request:
    """Return the request for ``count`` addresses of ``table``."""
    size = (count + 7) // 8 if table.is_bits else 2 * count
    function = table.read_function
    pdu = struct.pack(">BHH", function, address, count)
    return Request(pdu, bytes((function, size & 0xFF)), 2 + size, table, address, count)


def write_one_request(address: int, word: int) -> Request:
    """Return the request that writes one holding register (FC6)."""
    pdu = struct.pack(">BHH", 6, address, word)
    return Request(pdu, pdu, 5, Table.HOLDING, address, 1)


def write_many_request(address: int, words: Sequence[int]) -> Request:
    """Return the request that writes holding registers (FC16)."""
    count = len(words)
    head = struct.pack(">BHH", 16, address, count)
    pdu = head + struct.pack(f">B{count}H", 2 * count, *words)
    return Request(pdu, head, 5, Table.HOLDING, address, count)


def write_coils_request(address: int, bits: Sequence[int]) -> Request:
    """Return the request that writes coils (FC5 for one, FC15 for more)."""
    if len(bits) == 1:
        pdu = struct.pack(">BHH", 5, address, 0xFF00 if bits[0] else 0)
        return Request(pdu, pdu, 5, Table.COIL, address, 1)
    packed = pack_payload(Table.COIL, bits)
    head = struct.pack(">BHH", 15, address, len(bits))
    pdu = head + bytes((len(packed),)) + packed
    return Request(pdu, head, 5, Table.COIL, address, len(bits))


def echo_request(word: int) -> Request:
    """Return the request to send ``word`` back (FC8, sub-function 0: return query data)."""
    pdu = struct.pack(">BHH", DIAGNOSTICS, 0, word)
    return Request(pdu, pdu, 5)


@dataclass(frozen=True, slots=True)
class Frame:
    """A complete frame: who sent it, to which transaction it belongs (0 without), its PDU."""

    unit: int
    transaction: int
    pdu: bytes


class Framing(Protocol):
    """How PDUs travel; ``numbered`` says whether a reply names the transaction it belongs to."""

    numbered: bool

    def encode(self, unit: int, transaction: int, pdu: bytes) -> bytes:
        """Return the frame of a request."""
        ...

    def decode(self, data: bytes) -> tuple[int, Frame | None]:
        """Return the bytes that are done with and the first whole frame, None when there is none.

        Raises:
            FramingError: what has arrived can never become a frame.
        """
        ...


class MbapFraming:
    """The framing of Modbus TCP, of UDP and of Modbus Security: a header with a transaction id."""

    numbered = True

    def encode(self, unit: int, transaction: int, pdu: bytes) -> bytes:
        """Return the frame of a request."""
        return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit) + pdu

    def decode(self, data: bytes) -> tuple[int, Frame | None]:
        """Return the first frame of ``data``; see `Framing.decode`."""
        if len(data) < _MBAP:
            return 0, None
        transaction, protocol, length, unit = struct.unpack_from(">HHHB", data)
        if protocol != 0 or not 2 < length <= _LONGEST_PDU + 1:
            raise FramingError(f"no Modbus frame (protocol {protocol}, length {length})")
        end = 6 + length
        if len(data) < end:
            return 0, None
        return end, Frame(unit, transaction, data[_MBAP:end])


class RtuFraming:
    """The framing of serial lines: a unit id before and a CRC behind, and no transaction id.

    Noise before a frame is skipped. A byte that may begin a frame is waited for to become one,
    because a shorter "frame" inside its data would be no reply.
    """

    numbered = False

    def encode(self, unit: int, transaction: int, pdu: bytes) -> bytes:  # noqa: ARG002
        """Return the frame of a request."""
        body = bytes((unit,)) + pdu
        return body + struct.pack("<H", crc16_bytes(body))

    def decode(self, data: bytes) -> tuple[int, Frame | None]:
        """Return the first frame of ``data``; see `Framing.decode`."""
        for start in range(len(data)):
            size = _rtu_size(data[start : start + 3])
            if size is None:
                continue
            end = start + size
            if not size or end > len(data):
                return start, None
            body, crc = data[start : end - 2], data[end - 2 : end]
            if struct.pack("<H", crc16_bytes(body)) == crc:
                return end, Frame(body[0], 0, body[1:])
        return len(data), None


def _rtu_size(head: bytes) -> int | None:
    """Return the bytes of a reply that begins with ``head``; 0 not known yet, None no reply."""
    if not 1 <= head[0] <= 247:
        return None
    if len(head) < 2:
        return 0
    function = head[1]
    if function & EXCEPTION:
        return 5 if function & 0x7F in (*_READS, *_ECHOES) else None
    if function in _ECHOES:
        return 8
    if function not in _READS:
        return None
    return 5 + head[2] if len(head) == 3 else 0
