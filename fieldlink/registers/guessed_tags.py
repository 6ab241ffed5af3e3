"""Tags of a device that has no list of registers, guessed from one reading of its words.

Two words that make a float32 of an everyday size are taken for one, in the word order that makes
more of them; every other word is a uint16. A person has to compare the values and give the names.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from fieldlink.registers.tag import Tag
from fieldlink.registers.types import DataType, Order, Table
from fieldlink.registers.words import decode

__all__ = ["guess_tags"]

SMALLEST, LARGEST = 1e-3, 1e6
"""Sizes of measured values: two counters read as one float32 are far below or above, as a rule."""

_PREFIX = {Table.HOLDING: "H", Table.INPUT: "I"}


def guess_tags(words: Mapping[Table, Mapping[int, int]]) -> list[Tag]:
    """Return tags for registers by table and address; each says in its comment what was read.

    Args:
        words: table to address to the word that was read.
    """
    orders: tuple[Order, ...] = ("big", "little")
    by_order = {order: list(_tags(words, order)) for order in orders}
    floats = {
        order: sum(tag.data_type is DataType.FLOAT32 for tag in tags)
        for order, tags in by_order.items()
    }
    return by_order["big" if floats["big"] >= floats["little"] else "little"]


def _tags(words: Mapping[Table, Mapping[int, int]], order: Order) -> Iterator[Tag]:
    for table, known in words.items():
        addresses = iter(sorted(known))
        taken = -1
        for address in addresses:
            if address <= taken:
                continue
            name = f"{_PREFIX[table]}{address}"
            pair = [known[address], known[address + 1]] if address + 1 in known else []
            value = float(decode(pair, DataType.FLOAT32, word_order=order)) if pair else math.nan
            if SMALLEST <= abs(value) <= LARGEST:
                taken = address + 1
                comment = f"guessed: {value:.6g} when it was read"
                yield Tag(name, table, address, DataType.FLOAT32, word_order=order, comment=comment)
            else:
                comment = f"guessed: {known[address]} when it was read"
                yield Tag(name, table, address, DataType.UINT16, comment=comment)
