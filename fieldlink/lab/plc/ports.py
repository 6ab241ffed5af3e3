"""How a loop's program reaches the register image: tags by value, the exchange area by rule."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fieldlink.lab.plc.image import RegisterImage
from fieldlink.registers import BlockReader, ExchangeLayout, ReaderState, Refusal, Table, Tag

__all__ = ["ExchangePort", "TagPort", "counter_modulus"]


def counter_modulus(tag: Tag) -> int | None:
    """Return where a counter in a tag's registers begins again at 0; None for a float."""
    if tag.data_type.is_float:
        return None
    low, high = tag.data_type.bounds
    return int(high) - max(0, int(low)) + 1


class TagPort:
    """One tag of the image in engineering units; its registers exist from here on."""

    def __init__(self, image: RegisterImage, tag: Tag) -> None:
        self._image = image
        self._tag = tag
        self._written = False
        self._is_float = tag.data_type.is_float
        self._modulus = counter_modulus(tag)
        image.define(
            tag.table,
            tag.address,
            tag.count,
            writable=tag.writable,
            check=self._check if tag.writable else None,
        )

    @property
    def place(self) -> tuple[Table, int]:
        """Its table and first register."""
        return self._tag.table, self._tag.address

    @property
    def writable(self) -> bool:
        """Whether a client may write it."""
        return self._tag.writable

    def take_written(self) -> bool:
        """Whether a client has written it, the same value included, since this was asked last."""
        written, self._written = self._written, False
        return written

    def show(self, value: float) -> None:
        """Store a value, saturated at what the type holds.

        NaN goes into a float as it is; integers have no such value and keep what they hold.
        """
        tag = self._tag
        if not self._is_float and math.isnan(value):
            return
        if tag.bit is not None:
            word = self._image.get(tag.table, tag.address, 1)[0]
            self._put([tag.with_bit(word, value != 0.0)])
            return
        self._image.put(tag.table, tag.address, tag.encode(value, clamp=True))

    def count(self, number: int) -> None:
        """Store a counter, which begins again at 0 behind the largest number of its type."""
        self._put(self._tag.encode(number if self._modulus is None else number % self._modulus))

    def value(self) -> float:
        """Return what the registers say, from any writer; NaN when that is not a number."""
        words = self._image.get(self._tag.table, self._tag.address, self._tag.count)
        return self._tag.decode(words).value

    def _put(self, words: Sequence[int]) -> None:
        self._image.put(self._tag.table, self._tag.address, words)

    def _check(self, words: Sequence[int]) -> str | None:
        reading = self._tag.decode(words)
        if reading.quality.is_good:
            self._written = True
            return None
        return f"{self._tag.name} = {reading.value:g}: {reading.quality.value}"


class ExchangePort:
    """The exchange area of one loop, enabled until the operator says otherwise.

    Args:
        image: holds it.
        layout: where.
        reader: judges blocks.
        operator_switch: whether clients may write ``enable``, as an operator's panel does.
    """

    def __init__(
        self,
        image: RegisterImage,
        layout: ExchangeLayout,
        reader: BlockReader,
        *,
        operator_switch: bool = False,
    ) -> None:
        self._image = image
        self._layout = layout
        self._reader = reader
        self._ack_seq = 0
        self._refusal: Refusal | None = None
        if layout == ExchangeLayout.at(layout.enable):
            # The compact layout is one run of registers; those between its parts read 0.
            last = max(last for _, _, last in layout.spans())
            image.define(Table.HOLDING, layout.enable, last - layout.enable + 1)
        written = {"heartbeat", "writer", "commit", "bank_a", "bank_b"}
        if operator_switch:
            written.add("enable")
        for part, first, last in layout.spans():
            image.define(Table.HOLDING, first, last - first + 1, writable=part in written)
        self.enable(True)

    def enable(self, allowed: bool) -> None:
        """Set or clear the enable register."""
        self._image.put(Table.HOLDING, self._layout.enable, [int(allowed)])

    def scan(self, now: float) -> ReaderState:
        """Read the area once at ``now`` PLC seconds, acknowledge, return what is in force."""
        words = self._layout.view(lambda first, n: self._image.get(Table.HOLDING, first, n))
        state = self._reader.scan(words, now)
        if state.ack_seq != self._ack_seq:
            self._ack_seq, self._refusal = state.ack_seq, None
        for address, word in state.reply(self._layout, self._refusal).items():
            self._image.put(Table.HOLDING, address, [word])
        return state

    def tell(self, refusal: Refusal | None) -> None:
        """Acknowledge what the consumer made of the accepted block's model."""
        self._refusal = refusal
        if self._layout.ack_refusal is not None:
            code = 0 if refusal is None else refusal.code
            self._image.put(Table.HOLDING, self._layout.ack_refusal, [code])
