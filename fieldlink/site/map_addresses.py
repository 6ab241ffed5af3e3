"""Addresses as manuals write them: 100, 0x64, 16#64, 64h, 40101, 4x0101, 40101.3.

``100-101`` and ``100..101`` name the registers of one value, and %MW100 is holding register 100 of
controllers that serve their memory words as such (Schneider Electric, EcoStruxure).

Modbus requests count from 0 within each table. Many manuals count from 1 and put a digit for the
table in front: 40001 is holding register 0, 30001 input register 0, 10001 discrete input 0 and
00001 coil 0 (five digits), or the same with six digits (400001). ``0x0010`` is a coil among
addresses such as ``4x0101``, else a hexadecimal number.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable
from dataclasses import dataclass, replace
from typing import Literal

from fieldlink.printable import quoted
from fieldlink.registers import Table

__all__ = ["AddressStyle", "FoundAddress", "guess_style", "parse_address"]

AddressStyle = Literal["zero", "one", "modicon", "hex"]

MOST = 0.8
"""The share of addresses like 40001 from which the others are taken for slips of the pen."""

_TABLES = {"0": Table.COIL, "1": Table.DISCRETE, "3": Table.INPUT, "4": Table.HOLDING}
_MODICON = re.compile(r"([0134])x?(\d{4,5})", re.IGNORECASE)
_PREFIXED = re.compile(r"0x\d{4,5}", re.IGNORECASE)
_NUMBER = re.compile(r"(0x[0-9a-f]{1,9}|\d{1,9})(?:[./:](\d{1,2}))?", re.IGNORECASE)
_SPAN = re.compile(r"([^\s.\u2026\u2013-]+)\s*(?:-|\.\.+|\u2026|\u2013)\s*([^\s.\u2026\u2013-]+)")
_MEMORY_WORD = re.compile(r"%MW(\d{1,9})(?:[.:]X?(\d{1,2}))?", re.IGNORECASE)
_MARKED_HEX = re.compile(r"(?:16#|&h)([0-9a-f]+)|([0-9a-f]+)h", re.IGNORECASE)
_BARE_HEX = re.compile(r"[0-9a-f]{1,4}", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class FoundAddress:
    """A 0-based address; the table, the bit and the number of registers where the text says it."""

    address: int
    table: Table | None = None
    bit: int | None = None
    registers: int | None = None


def guess_style(cells: Iterable[str], of_numbers: Container[str] = ()) -> AddressStyle:
    """Return ``modicon`` when most addresses are written so, else ``zero``.

    ``of_numbers`` are the cells whose rows hold numbers: 12288 of an int16 is no discrete input.
    """
    given = [cell for cell in cells if cell.strip()]
    texts = [_first_of(cell).split(".")[0].strip() for cell in given]
    alike = [
        text
        for cell, text in zip(given, texts, strict=True)
        if (found := _MODICON.fullmatch(text))
        and not (cell in of_numbers and _TABLES[found[1]].is_bits)
    ]
    if texts and len(alike) >= MOST * len(texts) and not all(map(_PREFIXED.fullmatch, alike)):
        return "modicon"
    return "zero"


def parse_address(cell: str, style: AddressStyle) -> FoundAddress:
    """Return the address in a cell.

    Raises:
        ValueError: it holds none, with the reason and the remedy separated by a semicolon.
    """
    if (span := _SPAN.fullmatch(cell.strip())) is not None:
        first, last = (parse_address(end, style) for end in span.groups())
        if last.address < first.address or (first.bit, last.bit) != (None, None):
            raise ValueError(f"{cell!r} is no span of registers; give the first of them")
        return replace(first, registers=last.address - first.address + 1)
    if (word := _MEMORY_WORD.fullmatch(cell.strip())) is not None:
        bit = None if word[2] is None else _bit(word[2], cell)
        return FoundAddress(_in_range(int(word[1]), cell), Table.HOLDING, bit)
    text = _plain(cell.strip(), style)
    found = _NUMBER.fullmatch(text)
    if found is None:
        remedy = "give a number such as 100, 0x64 or 40101"
        if text.startswith("%"):
            remedy = "give the register's number: memory is counted differently from PLC to PLC"
        if _BARE_HEX.fullmatch(text):
            remedy = "for hexadecimal addresses give --addresses hex"
        raise ValueError(f"{quoted(cell)} is not an address; {remedy}")
    digits = found[1]
    bit = None if found[2] is None else _bit(found[2], cell)
    if style == "modicon":
        known = _MODICON.fullmatch(digits)
        if known is None:
            raise ValueError(
                f"{cell!r} is not written like the others (40001); correct it or the option "
                "--addresses"
            )
        return FoundAddress(_in_range(int(known[2]) - 1, cell), _TABLES[known[1]], bit)
    number = int(digits, 16) if digits.lower().startswith("0x") else int(digits)
    return FoundAddress(_in_range(number - (style == "one"), cell), None, bit)


def _first_of(cell: str) -> str:
    span = _SPAN.fullmatch(cell.strip())
    return span[1] if span else cell


def _plain(text: str, style: AddressStyle) -> str:
    """An address with its table's digit in front of the others, hexadecimal ones as 0x64."""
    if style == "modicon":
        return re.sub(r"^([0134])x(\d{4,5})", r"\1\2", text, flags=re.IGNORECASE)
    if style == "zero":
        text = re.sub(r"\.0+$", "", text)
    number, *bit = re.split(r"(?=[./:])", text, maxsplit=1)
    marked = _MARKED_HEX.fullmatch(number)
    if marked is not None:
        number = f"0x{marked[1] or marked[2]}"
    elif style == "hex" and _BARE_HEX.fullmatch(number):
        number = f"0x{number}"
    return "".join([number, *bit])


def _bit(text: str, cell: str) -> int:
    if int(text) > 15:
        raise ValueError(f"{cell!r}: a register has no bit {text}; give 0 to 15")
    return int(text)


def _in_range(address: int, cell: str) -> int:
    if not 0 <= address <= 0xFFFF:
        raise ValueError(f"{cell!r} is address {address}; addresses go from 0 to 65535")
    return address
