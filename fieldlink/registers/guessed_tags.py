"""Tags of a device that has no list of registers, guessed from one reading of its words.

Two words that make a float32 of an everyday size are taken for one, in the word order that makes
more of them; every other word is a uint16. Where both make as many, the likelier words decide. A
person has to compare the values and give the names.
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

ROUND = 0.5
"""Chance that the less significant word of a float32 is 0, as of a set-point of 54; else each is as
likely."""

_PREFIX = {Table.HOLDING: "H", Table.INPUT: "I"}


def guess_tags(words: Mapping[Table, Mapping[int, int]]) -> list[Tag]:
    """Return tags for registers by table and address; each says in its comment what was read.

    Args:
        words: table to address to the word that was read.
    """
    orders: tuple[Order, ...] = ("big", "little")
    by_order = {order: list(_tags(words, order)) for order in orders}
    return max(by_order.values(), key=lambda tags: _likeliness(tags, words))


def _likeliness(tags: list[Tag], words: Mapping[Table, Mapping[int, int]]) -> tuple[int, float]:
    """Return the number of floats, and the log-likelihood of all words but their first ones.

    The halves of two neighbouring floats make a third of an everyday size; what is then left alone
    looks like the end of a number, and a small mode or counter stands where such an end would.
    """
    floats, log_likelihood = 0, 0.0
    for tag in tags:
        if tag.data_type is DataType.FLOAT32:
            floats += 1
            low = words[tag.table][tag.address + (tag.word_order == "big")]
            log_likelihood += math.log(ROUND if low == 0 else (1.0 - ROUND) / 65535.0)
        else:
            # Every size, small to large, is as likely.
            log_likelihood -= math.log((words[tag.table][tag.address] + 1.0) * math.log(65536.0))
    return floats, log_likelihood


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
