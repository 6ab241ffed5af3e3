"""A tag: one named value of a device, where its registers are and what they mean.

``engineering value = scale * raw + offset``. A reading outside the engineering range ``low..high``,
or one that is not a number, keeps its value and says so in its quality: what to do about it is for
those who use it to decide. A tag with ``clamp`` is cut off at its range instead, and is good.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from fieldlink.registers.types import DataType, Order, RegisterValueError, Table
from fieldlink.registers.words import decode, decode_text, encode, encode_text, pattern

__all__ = ["DecodedValue", "Tag", "ValueQuality"]


class ValueQuality(Enum):
    """How far a reading can be trusted; the value is the text for people."""

    GOOD = "good"
    NOT_A_NUMBER = "not a number: the sensor or the PLC marks the value as bad"
    BELOW_RANGE = "below the low limit of the register map"
    ABOVE_RANGE = "above the high limit of the register map"
    INVALID = "the value that the register map declares to mean invalid"

    @property
    def is_good(self) -> bool:
        """Whether the value may be used."""
        return self is ValueQuality.GOOD


@dataclass(frozen=True, slots=True)
class DecodedValue:
    """One decoded value in engineering units, and how far it can be trusted.

    ``text`` is what a string holds; its ``value`` is NaN.
    """

    value: float
    quality: ValueQuality
    text: str | None = None


@dataclass(frozen=True, slots=True)
class Tag:
    """One row of a register map.

    Attributes:
        name: the tag's name, unique in its map.
        table: the Modbus table; coils and discrete inputs hold ``bool`` only.
        address: 0-based address of its first register (or bit).
        data_type: what the registers hold.
        scale, offset: engineering value = scale * raw + offset; scale is not zero.
        unit: engineering unit, for people.
        low, high: engineering range; None leaves that side open.
        writable: whether Fieldlink may ever write it.
        comment: free text.
        word_order, byte_order: those of the device, or of the map's row.
        bit: of a ``bool`` in a register: which bit, 0 the least significant; None for any bit.
        length: registers of a string; 0 for every other type.
        clamp: cut a value off at its range instead of marking it as bad.
        invalid: raw numbers (before the scale) that mean invalid.
        invalid_patterns: the same as bits of the registers, in big-endian order.
        every: seconds between reads; 0 reads it in every scan.
        node: node id of an OPC UA variable; empty for registers.
    """

    name: str
    table: Table
    address: int
    data_type: DataType
    scale: float = 1.0
    offset: float = 0.0
    unit: str = ""
    low: float | None = None
    high: float | None = None
    writable: bool = False
    comment: str = ""
    word_order: Order = "big"
    byte_order: Order = "big"
    bit: int | None = None
    length: int = 0
    clamp: bool = False
    invalid: tuple[float, ...] = ()
    invalid_patterns: tuple[int, ...] = ()
    every: float = 0.0
    node: str = ""

    @property
    def output_span(self) -> float | None:
        """Span of a controller output in its own units; None where the map is silent."""
        if self.low is None or self.high is None:
            return 100.0 if self.unit == "%" else None
        if self.unit == "%" and self.low <= 0.0 and self.high >= 100.0:
            # Room for readings a little beyond both ends does not count.
            return 100.0
        return self.high - self.low if self.high > self.low else None

    @property
    def count(self) -> int:
        """How many addresses the tag takes."""
        return self.length or self.data_type.registers

    @property
    def end(self) -> int:
        """The first address after the tag."""
        return self.address + self.count

    def decode(self, words: Sequence[int]) -> DecodedValue:
        """Return the engineering value of the tag's own ``words``.

        Raises:
            RegisterValueError: the number of words is not the tag's.
        """
        if self.data_type is DataType.STRING:
            if len(words) != self.count:
                raise RegisterValueError(
                    f"{self.name} takes {self.count} register(s), got {len(words)}"
                )
            return DecodedValue(
                math.nan, ValueQuality.GOOD, decode_text(words, byte_order=self.byte_order)
            )
        raw = decode(words, self.data_type, word_order=self.word_order, byte_order=self.byte_order)
        if self.bit is not None:
            raw = bool(_swapped(words[0], self.byte_order) >> self.bit & 1)
        bits = (
            pattern(words, word_order=self.word_order, byte_order=self.byte_order)
            if self.invalid_patterns
            else 0
        )
        return self.judge(float(raw), bits)

    def judge(self, raw: float, bits: int = 0) -> DecodedValue:
        """Return the reading of the ``raw`` number whose registers hold ``bits``.

        ``bits`` is looked at only by tags with `invalid_patterns`.
        """
        value = self.scale * raw + self.offset
        if self.invalid_patterns and bits in self.invalid_patterns:
            return DecodedValue(value, ValueQuality.INVALID)
        if self.invalid and raw in self.invalid:
            return DecodedValue(value, ValueQuality.INVALID)
        quality = self._quality(value)
        if self.clamp and self.low is not None and quality is ValueQuality.BELOW_RANGE:
            return DecodedValue(self.low, ValueQuality.GOOD)
        if self.clamp and self.high is not None and quality is ValueQuality.ABOVE_RANGE:
            return DecodedValue(self.high, ValueQuality.GOOD)
        return DecodedValue(value, quality)

    def encode(self, value: float, *, clamp: bool = False) -> list[int]:
        """Return the words for the engineering ``value``.

        With ``clamp`` a value beyond what the type can hold saturates and the engineering range is
        not looked at, as in a transmitter; without it both are refused.

        Raises:
            RegisterValueError: the value is outside the range, the type cannot hold it, or the tag
                is one bit of a register, whose other bits a write would lose.
        """
        if self.bit is not None:
            raise RegisterValueError(
                f"{self.name} is one bit of a register; write the whole register by address"
            )
        raw = (value - self.offset) / self.scale
        if clamp and math.isfinite(raw):
            smallest, largest = self.data_type.bounds
            raw = min(max(raw, smallest), largest)
        if not clamp and self._quality(value) in (
            ValueQuality.BELOW_RANGE,
            ValueQuality.ABOVE_RANGE,
        ):
            raise RegisterValueError(
                f"{self.name}: {value:g} is {self._quality(value).value} "
                f"({self.low} to {self.high} {self.unit})".rstrip()
            )
        try:
            return encode(
                raw, self.data_type, word_order=self.word_order, byte_order=self.byte_order
            )
        except RegisterValueError as error:
            raise RegisterValueError(f"{self.name}: {error}") from error

    def encode_inside(self, value: float, low: float, high: float) -> list[int]:
        """Return the words for ``value``, rounded to a count that lies in ``low`` to ``high``.

        Raises:
            RegisterValueError: as `encode`, or there is no such count.
        """
        words = self.encode(value)
        if self.data_type.is_float:
            return words
        # Scale times count misses round numbers by the last digits of a float64.
        margin = 1e-6 * abs(self.scale)
        beyond = self._beyond(words, low - margin, high + margin)
        if beyond:
            words = self.encode(self.decode(words).value - math.copysign(self.scale, beyond))
        if self._beyond(words, low - margin, high + margin):
            raise RegisterValueError(
                f"{self.name}: none of its counts of {abs(self.scale):g} lies in {low:g} to "
                f"{high:g}; widen that, or give the register more digits"
            )
        return words

    def _beyond(self, words: Sequence[int], low: float, high: float) -> float:
        """By how much the value of ``words`` is above ``high``, or (below 0) under ``low``."""
        held = self.decode(words).value
        return held - high if held > high else min(0.0, held - low)

    def with_bit(self, word: int, state: bool) -> int:
        """Return the register ``word`` with the tag's bit set to ``state``, the others kept."""
        if self.bit is None:
            raise RegisterValueError(f"{self.name} is not a single bit of a register")
        mask = _swapped(1 << self.bit, self.byte_order)
        return word | mask if state else word & ~mask

    def encode_text(self, text: str) -> list[int]:
        """Return the words for the ``text`` of a string tag.

        Raises:
            RegisterValueError: it does not fit.
        """
        try:
            return encode_text(text, self.count, byte_order=self.byte_order)
        except RegisterValueError as error:
            raise RegisterValueError(f"{self.name}: {error}") from error

    def _quality(self, value: float) -> ValueQuality:
        if not math.isfinite(value):
            return ValueQuality.NOT_A_NUMBER
        if self.low is not None and value < self.low:
            return ValueQuality.BELOW_RANGE
        if self.high is not None and value > self.high:
            return ValueQuality.ABOVE_RANGE
        return ValueQuality.GOOD


def _swapped(word: int, byte_order: Order) -> int:
    return word if byte_order == "big" else word >> 8 | (word & 0xFF) << 8
