"""What a reader is, and what readers share."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

from fieldlink.assess.cutting import starts_from
from fieldlink.assess.job import Cut, Job, Piece
from fieldlink.assess.series import Series

__all__ = ["PERIOD_ROWS", "Named", "Opening", "Reader", "split_in_time"]

WINDOWS_A_PIECE = 16
"""Windows of a piece where a loop's recording is long: some seconds of work, so that a killed run
repeats little and several workers share one loop."""

PERIOD_ROWS = 100
"""First samples of a loop from which its period is taken when pieces are planned."""

Named = tuple[str, Series]
"""A loop's name and one of its windows."""


@dataclass(frozen=True, slots=True)
class Opening:
    """Listed before a file is opened, so that one that kills the process is known."""

    piece: Piece


class Reader(Protocol):
    """Reads one kind of place, such as a folder, a file or a database."""

    def pieces(self, job: Job, place: int, after: str) -> Iterator[Piece | Opening]:
        """List what there is to read, always in the same order.

        Args:
            job: what is assessed.
            place: number of the place.
            after: path of the file behind which the list begins; empty for the whole list.

        Raises:
            FieldlinkError: the place cannot be opened.
        """
        ...

    def windows(self, job: Job, piece: Piece) -> Iterator[Named]:
        """Read a piece, a window at a time.

        Raises:
            FieldlinkError: the samples cannot be read; `PlaceAwayError` or `StoreAwayError` where
                nothing of the place can be read now.
        """
        ...


def split_in_time(piece: Piece, cut: Cut, first: float, last: float, period: float) -> list[Piece]:
    """Return a dated loop's piece in parts of some windows; their order is that of time.

    Args:
        piece: the whole loop.
        cut: how windows are cut.
        first, last: of the loop's samples, seconds since 1970.
        period: seconds between samples, about.
    """
    begin = first if cut.since is None else max(first, cut.since)
    end = last if cut.until is None else min(last, cut.until)
    window = cut.every or cut.samples * period
    length = WINDOWS_A_PIECE * window
    anchor = starts_from(cut, dated=True, first=first)
    edges: list[float | None] = [None]
    if begin < end and length > 0.0:
        edge = anchor + (math.floor((begin - anchor) / length) + 1) * length
        while edge < end - 0.5 * window:
            edges.append(edge)
            edge += length
    return [
        replace(piece, since=since, until=until)
        for since, until in zip(edges, [*edges[1:], None], strict=True)
    ]
