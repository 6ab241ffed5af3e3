"""Register types: how numbers lie in 16-bit Modbus registers.

A value of ``n`` registers is ``n`` big-endian words, the most significant first, when both orders
are ``"big"``. ``word_order="little"`` reverses the words, ``byte_order="little"`` swaps the bytes
inside each word. For a 32-bit value 0xAABBCCDD the four combinations are what device manuals call

    word_order   byte_order   bytes on the wire
    big          big          AB CD   "ABCD"
    little       big          CD AB   "CDAB"
    big          little       BA DC   "BADC"
    little       little       DC BA   "DCBA"

Numbers go through `decode` and `encode`, text through `decode_text` and `encode_text`. A new type
of number is a new member of `DataType` and a row in `_CODECS`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

from fieldlink.errors import FieldlinkError

__all__ = [
    "ORDERS",
    "DataType",
    "Order",
    "RegisterValueError",
    "Table",
    "decode",
    "decode_text",
    "encode",
    "encode_text",
    "order_name",
    "pattern",
]

Order = Literal["big", "little"]


class RegisterValueError(FieldlinkError, ValueError):
    """A value that its registers cannot hold, or registers that do not make a value."""


class Table(StrEnum):
    """The four address spaces of a Modbus device."""

    HOLDING = "holding"
    INPUT = "input"
    COIL = "coil"
    DISCRETE = "discrete"

    @property
    def is_bits(self) -> bool:
        """Whether an address of this table is one bit and not a 16-bit register."""
        return self in (Table.COIL, Table.DISCRETE)

    @property
    def is_writable(self) -> bool:
        """Whether the protocol has a function code that writes to this table."""
        return self in (Table.HOLDING, Table.COIL)

    @property
    def read_function(self) -> int:
        """The Modbus function code that reads this table."""
        return {"coil": 1, "discrete": 2, "holding": 3, "input": 4}[self.value]

    @property
    def read_limit(self) -> int:
        """The most addresses one read request may ask for (Modbus application protocol 1.1b3)."""
        return 2000 if self.is_bits else 125


class DataType(StrEnum):
    """What a tag's registers hold."""

    __hash__ = str.__hash__  # as fast as a string's: each reading looks up its type

    INT16 = "int16"
    UINT16 = "uint16"
    INT32 = "int32"
    UINT32 = "uint32"
    INT64 = "int64"
    UINT64 = "uint64"
    FLOAT32 = "float32"
    FLOAT64 = "float64"
    BOOL = "bool"
    BCD16 = "bcd16"
    BCD32 = "bcd32"
    STRING = "string"

    @property
    def registers(self) -> int:
        """How many registers one value takes; a string takes as many as its tag says."""
        return _CODECS[self].registers

    @property
    def is_number(self) -> bool:
        """Whether the type holds a quantity and not a state or a text."""
        return self not in (DataType.BOOL, DataType.STRING)

    @property
    def is_bcd(self) -> bool:
        """Whether each four bits hold a decimal digit."""
        return _CODECS[self].is_bcd

    @property
    def format_code(self) -> str:
        """The format character of `struct` for the words in big-endian order."""
        return _CODECS[self].code

    @property
    def is_float(self) -> bool:
        """Whether the type can hold fractions and NaN."""
        return _CODECS[self].is_float

    @property
    def modulus(self) -> float:
        """How many values a counter of the type goes through before it begins again."""
        low, high = self.bounds
        return math.inf if self.is_float else high - low + 1.0

    @property
    def bounds(self) -> tuple[float, float]:
        """The smallest and the largest finite value the type can hold."""
        return _CODECS[self].low, _CODECS[self].high


@dataclass(frozen=True, slots=True)
class _Codec:
    """``code`` is the format character of `struct`; ``low`` to ``high`` is what it can hold."""

    code: str
    registers: int
    low: float
    high: float
    is_bcd: bool = False
    number: struct.Struct = field(init=False)
    """The number as big-endian bytes, compiled once: every reading of every tag goes through it."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "number", struct.Struct(f">{self.code}"))

    @property
    def is_float(self) -> bool:
        return self.code in "fd"


_FLOAT32_MAX = (2.0 - 2.0**-23) * 2.0**127

_CODECS: dict[DataType, _Codec] = {
    DataType.INT16: _Codec("h", 1, -(2**15), 2**15 - 1),
    DataType.UINT16: _Codec("H", 1, 0, 2**16 - 1),
    DataType.INT32: _Codec("i", 2, -(2**31), 2**31 - 1),
    DataType.UINT32: _Codec("I", 2, 0, 2**32 - 1),
    DataType.INT64: _Codec("q", 4, -(2**63), 2**63 - 1),
    DataType.UINT64: _Codec("Q", 4, 0, 2**64 - 1),
    DataType.FLOAT32: _Codec("f", 2, -_FLOAT32_MAX, _FLOAT32_MAX),
    DataType.FLOAT64: _Codec("d", 4, -1.7976931348623157e308, 1.7976931348623157e308),
    DataType.BOOL: _Codec("H", 1, 0, 1),
    DataType.BCD16: _Codec("H", 1, 0, 9999, is_bcd=True),
    DataType.BCD32: _Codec("I", 2, 0, 99_999_999, is_bcd=True),
    DataType.STRING: _Codec("H", 1, 0, 0),
}

# Words of registers from the bytes of a number, by byte order and count.
_REGISTERS: dict[Order, dict[int, struct.Struct]] = {
    "big": {count: struct.Struct(f">{count}H") for count in (1, 2, 4)},
    "little": {count: struct.Struct(f"<{count}H") for count in (1, 2, 4)},
}

ORDERS: Mapping[str, tuple[Order, Order]] = {
    "ABCD": ("big", "big"),
    "CDAB": ("little", "big"),
    "BADC": ("big", "little"),
    "DCBA": ("little", "little"),
}
"""What device manuals call the pairs (word order, byte order)."""


def order_name(word_order: Order, byte_order: Order) -> str:
    """Return the name that device manuals give to the pair of orders, such as ``"CDAB"``."""
    return next(name for name, pair in ORDERS.items() if pair == (word_order, byte_order))


def decode(
    words: Sequence[int],
    data_type: DataType,
    *,
    word_order: Order = "big",
    byte_order: Order = "big",
) -> int | float | bool:
    """Return the raw value that ``words`` (exactly ``data_type.registers`` of them) hold.

    Any non-zero register is a true ``bool``. Floats may come out as NaN or infinite, and BCD with a
    digit above 9 comes out as NaN.

    Raises:
        RegisterValueError: the number of words is not the type's, a word is not 0..65535, or the
            type is a string (see `decode_text`).
    """
    codec = _number_codec(data_type)
    if len(words) != codec.registers:
        raise RegisterValueError(
            f"{data_type} takes {codec.registers} register(s), got {len(words)}"
        )
    if data_type is DataType.BOOL:
        return _as_words(words, "big", "big")[0] != 0
    registers = _REGISTERS[byte_order][codec.registers]
    try:
        packed = registers.pack(*(words if word_order == "big" else words[::-1]))
    except struct.error:
        _require_words(words)
        raise
    value: int | float = codec.number.unpack(packed)[0]
    return _from_bcd(int(value)) if codec.is_bcd else value


def encode(
    value: float | bool,
    data_type: DataType,
    *,
    word_order: Order = "big",
    byte_order: Order = "big",
) -> list[int]:
    """Return the words that hold ``value``; integer types round to the nearest, ties to even.

    NaN and infinities go into the float types as they are.

    Raises:
        RegisterValueError: the type cannot hold the value.
    """
    codec = _number_codec(data_type)
    if data_type is DataType.BOOL:
        if value not in (0, 1):
            raise RegisterValueError(f"{value!r} is not a bool; write 0 or 1")
        return [int(value)]
    if codec.is_float:
        if math.isfinite(value) and not codec.low <= value <= codec.high:
            raise RegisterValueError(f"{value!r} does not fit {data_type} (at most {codec.high:g})")
        packed = codec.number.pack(value)
    else:
        if not math.isfinite(value):
            raise RegisterValueError(f"{value!r} does not fit {data_type}; use a float type")
        whole = round(value)
        if not codec.low <= whole <= codec.high:
            raise RegisterValueError(
                f"{value!r} does not fit {data_type} ({codec.low} to {codec.high})"
            )
        packed = codec.number.pack(int(str(whole), 16) if codec.is_bcd else whole)
    words = list(_REGISTERS[byte_order][codec.registers].unpack(packed))
    if word_order == "little":
        words.reverse()
    return words


def decode_text(words: Sequence[int], *, byte_order: Order = "big") -> str:
    """Return the text in ``words``, two characters a register, up to the first zero.

    What is not ASCII comes out as U+FFFD; blanks at the end are left out.

    Raises:
        RegisterValueError: a word is not 0..65535.
    """
    ordered = _as_words(words, "big", byte_order)
    raw = struct.pack(f">{len(ordered)}H", *ordered)
    return raw.split(b"\0", 1)[0].decode("ascii", errors="replace").rstrip()


def encode_text(text: str, registers: int, *, byte_order: Order = "big") -> list[int]:
    """Return ``registers`` words that hold ``text``, filled up with zeros.

    Raises:
        RegisterValueError: the text is too long or not ASCII.
    """
    try:
        raw = text.encode("ascii")
    except UnicodeEncodeError as error:
        raise RegisterValueError(
            f"{text!r} is not ASCII; leave out {error.object[error.start]!r}"
        ) from error
    if len(raw) > 2 * registers:
        raise RegisterValueError(
            f"{text!r} has {len(raw)} characters, {registers} register(s) hold {2 * registers}"
        )
    words = struct.unpack(f">{registers}H", raw.ljust(2 * registers, b"\0"))
    return _as_words(words, "big", byte_order)


def pattern(words: Sequence[int], *, word_order: Order = "big", byte_order: Order = "big") -> int:
    """Return the bits of ``words`` as one unsigned number, as manuals write them: 0x8000."""
    number = 0
    for word in _as_words(words, word_order, byte_order):
        number = number << 16 | word
    return number


def _number_codec(data_type: DataType) -> _Codec:
    if data_type is DataType.STRING:
        raise RegisterValueError("a string is not a number; use decode_text and encode_text")
    return _CODECS[data_type]


def _from_bcd(word: int) -> int | float:
    """Return the decimal number whose digits are the hexadecimal ones; NaN when one is above 9."""
    digits = f"{word:x}"
    return int(digits) if digits.isdecimal() else math.nan


def _require_words(words: Sequence[int]) -> None:
    for word in words:
        if not 0 <= word <= 0xFFFF:
            raise RegisterValueError(f"{word!r} is not a register value (0 to 65535)")


def _as_words(words: Sequence[int], word_order: Order, byte_order: Order) -> list[int]:
    """Reorder between device order and big-endian order; the mapping is its own inverse."""
    _require_words(words)
    ordered = list(words) if word_order == "big" else list(reversed(words))
    if byte_order == "little":
        ordered = [(word >> 8) | ((word & 0xFF) << 8) for word in ordered]
    return ordered
