"""How vendors' lists say what one count of a register is worth: factor, divisor, decimals, range.

    scale_cell({"divisor": "10", "type": "int16"})   # "0.1": a raw 215 is 21.5
    scale_cell({"decimals": "2", "type": "int16"})   # "0.01"
    limits("0 .. 16,5 bar")                          # ("0", "16.5")

What is lost here is a wrong measurement, so that a cell that is not understood makes a bad row.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from fieldlink.printable import quoted
from fieldlink.registers import DataType
from fieldlink.site.number_cells import may_group
from fieldlink.whole_numbers import whole_number

__all__ = ["LIST_COLUMNS", "limits", "scale_cell"]

LIST_COLUMNS = ("divisor", "decimals", "range", "read_only")
"""Columns of vendors' lists only; a register map has scale, low and high, and writable instead."""

_MOST_DECIMALS = 9
"""A 32-bit number has ten digits; one of them stands before the point."""
_NUMBER = r"[-+]?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?"
_DIVIDED = re.compile(rf"(?:1\s*)?[/:\u00f7]\s*({_NUMBER})", re.IGNORECASE)
_POWER = re.compile(r"10\s*(?:\^|\*\*)\s*\(?([-+]?\d{1,2})\)?")
_TIMES = re.compile(rf"[*x\u00d7\u00b7]\s*({_NUMBER})", re.IGNORECASE)
_WITH_UNIT = re.compile(rf"({_NUMBER})(?:\s*[%\u00b0]\D*|\s+[^\W\d_].*|[^\W\d_]\D*)", re.IGNORECASE)
_BOTH_ENDS = re.compile(
    rf"\[?\s*({_NUMBER})\s*(?:\.{{2,3}}|\u2026|to|bis|[-\u2013\u2014~;])\s*({_NUMBER})"
    r"\s*\]?\s*(?:[%\u00b0\u00b5]|[^\W\d_]|$).*",
    re.IGNORECASE,
)


def scale_cell(values: Mapping[str, str]) -> str:
    """Return the register map's cell ``scale`` of a row, "" where the row says nothing of it.

    Args:
        values: cells by column, in the words of a register map and of ``LIST_COLUMNS``.

    Raises:
        ValueError: a cell is not understood; the column, the reason and the remedy, separated by
            semicolons.
    """
    factor = _factor(values.get("scale", ""))
    divisor = values.get("divisor", "")
    if divisor:
        number = _plain(_divisor_of(divisor))
        if number is None or not number:
            raise ValueError(f"divisor; {divisor!r} cannot divide; give a number such as 10")
        over = _plain(factor or "1")
        if over is None:
            # The row's own reading of the scale says what is wrong with it.
            return factor
        return repr(over / number)
    decimals = values.get("decimals", "")
    if factor or not decimals or _is_fractional(values.get("type", "")):
        return factor
    places = whole_number(decimals, _MOST_DECIMALS)
    if places is None:
        raise ValueError(
            f"decimals; {quoted(decimals)} does not count decimals; give 0 to {_MOST_DECIMALS}"
        )
    return repr(10.0**-places)


def limits(cell: str) -> tuple[str, str] | None:
    """Return both ends of a range such as ``0..100``, ``-10 to +50 degC``; None if not clear."""
    found = _BOTH_ENDS.fullmatch(cell.strip())
    if found is None:
        return None
    ends = _plain(found[1]), _plain(found[2])
    if ends[0] is None or ends[1] is None or ends[0] >= ends[1]:
        return None
    return repr(ends[0]), repr(ends[1])


def _factor(cell: str) -> str:
    """A scale as a plain number where it is clear; else the cell, which is then a bad one."""
    text = cell.strip()
    if found := _DIVIDED.fullmatch(text):
        number = _plain(found[1])
        return repr(1.0 / number) if number else cell
    if found := _POWER.fullmatch(text):
        return repr(10.0 ** int(found[1]))
    if found := _TIMES.fullmatch(text):
        number = _plain(found[1])
        # "x10" may be about the value or about the register: the one multiplies, the other
        # divides. Only a factor below one cannot be meant the other way round.
        if number is not None and abs(number) >= 1.0:
            raise ValueError(
                f"scale; {cell!r} does not say whether the value or the register is larger; "
                f"write {number:g} where a raw 1 means {number:g}, else 1/{number:g}"
            )
        return cell if number is None else repr(number)
    found = _WITH_UNIT.fullmatch(text)
    return found[1] if found and _plain(text) is None else cell


def _divisor_of(cell: str) -> str:
    found = _DIVIDED.fullmatch(cell.strip())
    return found[1] if found else cell


def _is_fractional(data_type: str) -> bool:
    """Whether decimals are those that a panel shows: a float or a text has its own."""
    return data_type in (DataType.FLOAT32, DataType.FLOAT64, DataType.STRING, DataType.BOOL)


def _plain(text: str) -> float | None:
    """The number in a text; None where it is none, or its comma may group digits."""
    text = text.strip()
    if re.fullmatch(_NUMBER, text, re.IGNORECASE) is None or ("," in text and may_group(text)):
        return None
    return float(text.replace(",", "."))
