"""Whole numbers in texts that people and lists give, which may have thousands of digits."""

from __future__ import annotations

__all__ = ["whole_number"]


def whole_number(text: str, most: int) -> int | None:
    """Return the whole number from 0 to ``most`` that a text is; None where it is none.

    Python refuses to read a number of thousands of digits; zeros in front are no matter.
    """
    digits = text.lstrip("0")
    if not text.isdecimal() or len(digits) > len(str(most)):
        return None
    number = int(digits or "0")
    return number if number <= most else None
