"""A tag: one named value of a device, where its registers are and what they mean.

``engineering value = scale * raw + offset``. A reading outside the engineering range ``low..high``,
or one that is no number, keeps its value and says so in its quality: what to do about it is for
those who use it to decide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from fieldlink.registers.types import (
    DataType,
    Order,
    RegisterValueError,
    Table,
    decode,
    encode,
)

__all__ = ["Quality", "Reading", "Tag"]


class Quality(Enum):
    """How far a reading can be trusted; the value is the text for people."""

    GOOD = "good"
    NOT_A_NUMBER = "not a number: the sensor or the PLC marks the value as bad"
    BELOW_RANGE = "below the low limit of the register map"
    ABOVE_RANGE = "above the high limit of the register map"

    @property
    def is_good(self) -> bool:
        """Whether the value may be used."""
        return self is Quality.GOOD


@dataclass(frozen=True, slots=True)
class Reading:
    """One decoded value in engineering units, and how far it can be trusted."""

    value: float
    quality: Quality


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
        word_order, byte_order: those of the device.
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

    @property
    def count(self) -> int:
        """How many addresses the tag takes."""
        return self.data_type.registers

    @property
    def end(self) -> int:
        """The first address after the tag."""
        return self.address + self.count

    def decode(self, words: Sequence[int]) -> Reading:
        """Return the engineering value of the tag's own ``words``.

        Raises:
            RegisterValueError: the number of words is not the tag's.
        """
        raw = decode(words, self.data_type, word_order=self.word_order, byte_order=self.byte_order)
        value = self.scale * float(raw) + self.offset
        return Reading(value, self._quality(value))

    def encode(self, value: float, *, clamp: bool = False) -> list[int]:
        """Return the words for the engineering ``value``.

        With ``clamp`` a value beyond what the type can hold saturates and the engineering range is
        not looked at, as in a transmitter; without it both are refused.

        Raises:
            RegisterValueError: the value is outside the range, or the type cannot hold it.
        """
        raw = (value - self.offset) / self.scale
        if clamp and math.isfinite(raw):
            smallest, largest = self.data_type.bounds
            raw = min(max(raw, smallest), largest)
        if not clamp and self._quality(value) in (Quality.BELOW_RANGE, Quality.ABOVE_RANGE):
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

    def _quality(self, value: float) -> Quality:
        if not math.isfinite(value):
            return Quality.NOT_A_NUMBER
        if self.low is not None and value < self.low:
            return Quality.BELOW_RANGE
        if self.high is not None and value > self.high:
            return Quality.ABOVE_RANGE
        return Quality.GOOD
