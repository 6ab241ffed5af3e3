"""Text from outside without the control characters that a terminal or a log would act on."""

from __future__ import annotations

import os

__all__ = ["as_printable", "as_text", "quoted", "shortened"]

LONGEST = 80
"""Characters of a value in a message: more than any name, less than a line too many."""


def as_printable(text: str, *, lines: bool = False) -> str:
    """Return the text with a question mark in place of each control character.

    Args:
        text: any text, such as a name from a file.
        lines: whether it may have several lines; otherwise line ends become blanks.
    """
    if text.isprintable():
        return text
    if lines:
        return "\n".join(as_printable(line) for line in text.split("\n"))
    return "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))


def as_text(path: str) -> str:
    """Return a path as text that can be stored: a byte that is not of UTF-8 as ``\\xe4``.

    File systems take any bytes as a name, as from an archive with names in Latin-1.
    """
    return os.fsencode(path).decode("utf-8", "backslashreplace")


def shortened(text: str) -> str:
    """Return text with its middle left out when it is too long for a message."""
    if len(text) <= LONGEST:
        return text
    half = (LONGEST - 5) // 2
    return f"{text[:half]} ... {text[-half:]}"


def quoted(value: object) -> str:
    """Return a value as a message shows it: text in quotes, printable, and not too long."""
    return shortened(repr(value))
