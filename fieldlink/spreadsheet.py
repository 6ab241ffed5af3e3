"""Cells for spreadsheets: text from outside that a spreadsheet would take for a formula.

A tag named ``=HYPERLINK(...)`` is text here, and a formula in the spreadsheet. An apostrophe
before it says that it is text, as people write it there; a register map is read without it.
"""

from __future__ import annotations

__all__ = ["from_cell", "to_cell"]

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""How a cell begins that a spreadsheet evaluates (OWASP, "CSV Injection")."""


def to_cell(text: str) -> str:
    """Return text as a cell that no spreadsheet evaluates; numbers are left as they are."""
    if text.startswith(_FORMULA) and not _is_number(text):
        return f"'{text}"
    # What has an apostrophe already gets another one, so that none is lost on the way back.
    return f"'{text}" if text.startswith("'") else text


def from_cell(cell: str) -> str:
    """Return the text of a cell that `to_cell` wrote."""
    return cell[1:] if cell[:2] in _WRITTEN else cell


_WRITTEN = frozenset(f"'{begin}" for begin in (*_FORMULA, "'"))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
