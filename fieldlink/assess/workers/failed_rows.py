"""What a worker says of a place or a piece that failed, as its row and its sentence have it."""

from __future__ import annotations

from typing import Any

from fieldlink.assess.job import Piece
from fieldlink.assess.table_row import error_row, moment_text
from fieldlink.printable import as_printable

__all__ = ["failed_row", "placed", "without_place"]


def placed(place: str, message: str) -> str:
    """The message behind the name of its place, which is told once."""
    return message if message.startswith(place) else f"{place}: {message}"


def without_place(message: str, piece: Piece) -> str:
    """The message without the file, which its row has: once for each of several problems."""
    names = {piece.path, as_printable(piece.path), piece.file} - {""}
    # the longest first: what is shown is often the end of the path
    for place in sorted(names, key=len, reverse=True):
        message = message.replace(f"{place}: ", "").replace(f"{place}:", "line ")
    return message


def failed_row(piece: Piece, message: str) -> dict[str, Any]:
    """The row of a piece that could not be read."""
    start = "" if piece.since is None else moment_text(piece.since, dated=True)
    return error_row(piece.file, piece.loop, start, message)
