"""Addresses as manuals write them: 100, 0x64, 40101, 4x0101, 40101.3.

Modbus requests count from 0 within each table. Many manuals count from 1 and put a digit for the
table in front: 40001 is holding register 0, 30001 input register 0, 10001 discrete input 0 and
00001 coil 0 (five digits), or the same with six digits (400001).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from fieldlink.registers import Table

__all__ = ["AddressStyle", "FoundAddress", "guess_style", "parse_address"]

AddressStyle = Literal["zero", "one", "modicon"]

MOST = 0.8
"""The share of addresses like 40001 from which the others are taken for slips of the pen."""

_TABLES = {"0": Table.COIL, "1": Table.DISCRETE, "3": Table.INPUT, "4": Table.HOLDING}
_MODICON = re.compile(r"([0134])x?(\d{4,5})", re.IGNORECASE)
_NUMBER = re.compile(r"(0x[0-9a-f]+|\d+)(?:[./:](\d{1,2}))?", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class FoundAddress:
    """A 0-based address; the table where the text says it, the bit behind a dot."""

    address: int
    table: Table | None = None
    bit: int | None = None


def guess_style(cells: Iterable[str]) -> AddressStyle:
    """Return ``modicon`` when most addresses are written so, else ``zero``."""
    texts = [cell.split(".")[0].strip() for cell in cells if cell.strip()]
    written_so = sum(_MODICON.fullmatch(text) is not None for text in texts)
    return "modicon" if texts and written_so >= MOST * len(texts) else "zero"


def parse_address(cell: str, style: AddressStyle) -> FoundAddress:
    """Return the address in a cell.

    Raises:
        ValueError: it holds none, with the reason and the remedy separated by a semicolon.
    """
    text = re.sub(r"\.0+$", "", cell.strip()) if style == "zero" else cell.strip()
    found = _NUMBER.fullmatch(re.sub(r"^([0134])x(\d{4,5})", r"\1\2", text, flags=re.IGNORECASE))
    if found is None:
        raise ValueError(f"{cell!r} is not an address; give a number such as 100, 0x64 or 40101")
    digits, bit_text = found[1], found[2]
    bit = None if bit_text is None else int(bit_text)
    if bit is not None and bit > 15:
        raise ValueError(f"{cell!r}: a register has no bit {bit}; give 0 to 15")
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


def _in_range(address: int, cell: str) -> int:
    if not 0 <= address <= 0xFFFF:
        raise ValueError(f"{cell!r} is address {address}; addresses go from 0 to 65535")
    return address
