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
of number is a new member of `DataType` and a row in `CODECS`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

from fieldlink.errors import FieldlinkError

__all__ = [
    "CODECS",
    "ORDERS",
    "Codec",
    "DataType",
    "Order",
    "RegisterValueError",
    "Table",
    "order_name",
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
        return CODECS[self].registers

    @property
    def is_number(self) -> bool:
        """Whether the type holds a quantity and not a state or a text."""
        return self not in (DataType.BOOL, DataType.STRING)

    @property
    def is_bcd(self) -> bool:
        """Whether each four bits hold a decimal digit."""
        return CODECS[self].is_bcd

    @property
    def format_code(self) -> str:
        """The format character of `struct` for the words in big-endian order."""
        return CODECS[self].code

    @property
    def is_float(self) -> bool:
        """Whether the type can hold fractions and NaN."""
        return CODECS[self].is_float

    @property
    def modulus(self) -> float:
        """How many values a counter of the type goes through before it begins again."""
        low, high = self.bounds
        return math.inf if self.is_float else high - low + 1.0

    @property
    def bounds(self) -> tuple[float, float]:
        """The smallest and the largest finite value the type can hold."""
        return CODECS[self].low, CODECS[self].high


@dataclass(frozen=True, slots=True)
class Codec:
    """How a number lies in its registers.

    Attributes:
        code: the format character of `struct`.
        registers: how many it takes.
        low, high: the smallest and the largest finite value it can hold.
        is_bcd: whether each four bits hold a decimal digit.
    """

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
        """Whether it can hold fractions and NaN."""
        return self.code in "fd"


_FLOAT32_MAX = (2.0 - 2.0**-23) * 2.0**127

CODECS: dict[DataType, Codec] = {
    DataType.INT16: Codec("h", 1, -(2**15), 2**15 - 1),
    DataType.UINT16: Codec("H", 1, 0, 2**16 - 1),
    DataType.INT32: Codec("i", 2, -(2**31), 2**31 - 1),
    DataType.UINT32: Codec("I", 2, 0, 2**32 - 1),
    DataType.INT64: Codec("q", 4, -(2**63), 2**63 - 1),
    DataType.UINT64: Codec("Q", 4, 0, 2**64 - 1),
    DataType.FLOAT32: Codec("f", 2, -_FLOAT32_MAX, _FLOAT32_MAX),
    DataType.FLOAT64: Codec("d", 4, -1.7976931348623157e308, 1.7976931348623157e308),
    DataType.BOOL: Codec("H", 1, 0, 1),
    DataType.BCD16: Codec("H", 1, 0, 9999, is_bcd=True),
    DataType.BCD32: Codec("I", 2, 0, 99_999_999, is_bcd=True),
    DataType.STRING: Codec("H", 1, 0, 0),
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
