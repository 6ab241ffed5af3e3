"""Loops that have had other names: which rows are theirs.

    names = FormerNames([Renaming(1_000, "FC101", "FIC101")])
    names.own(ESTIMATES, "FIC101")         # rows of FIC101, and those of FC101 up to that moment
    names.at_present("FC101", 500)         # "FIC101"

Rows are never changed, so each keeps the name that its loop had. A name may be given to another
loop later, or back to the same one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, Select, Table, and_, or_, select

from fieldlink.store.schema import EVENTS

__all__ = ["RENAMED", "FormerNames", "Renaming"]

RENAMED = "loop.renamed"
"""Kind of the event; its source is the new name, and ``former`` in its detail the one before."""


@dataclass(frozen=True, slots=True)
class Renaming:
    """From ``utc_ms`` (milliseconds since 1970) on the loop ``former`` is called ``name``."""

    utc_ms: int
    former: str
    name: str


@dataclass(frozen=True, slots=True)
class _Stretch:
    """A name that a loop had: after a moment, up to another one; None where it has no bound."""

    name: str
    after: int | None
    until: int | None


class FormerNames:
    """What the loops of a historian were called.

    Args:
        renamings: in the order in which they happened.
    """

    def __init__(self, renamings: Iterable[Renaming] = ()) -> None:
        self._renamings = tuple(renamings)

    @staticmethod
    def query() -> Select[Any]:
        """Return the query whose rows `of_rows` takes."""
        c = EVENTS.c
        query = select(c.utc_ms, c.source, c.detail).where(c.kind == RENAMED)
        return query.order_by(c.utc_ms, c.id)

    @classmethod
    def of_rows(cls, rows: Iterable[Any]) -> FormerNames:
        """Build from stored events; those of a release that did not keep the name are left out."""
        return cls(
            Renaming(row.utc_ms, str(row.detail["former"]), row.source)
            for row in rows
            if isinstance(row.detail, dict) and "former" in row.detail
        )

    def own(self, table: Table, loop: str) -> ColumnElement[bool]:
        """Return the condition for the rows of a loop (columns ``loop`` and ``utc_ms``)."""
        c = table.c
        parts = []
        for stretch in self._stretches(loop):
            part = [c.loop == stretch.name]
            if stretch.after is not None:
                part.append(c.utc_ms > stretch.after)
            if stretch.until is not None:
                part.append(c.utc_ms <= stretch.until)
            parts.append(and_(*part))
        return or_(*parts)

    def at_present(self, loop: str, utc_ms: int) -> str:
        """Return what the loop is called now that was called ``loop`` at a moment."""
        name = loop
        for one in self._renamings:
            if one.former == name and one.utc_ms >= utc_ms:
                name, utc_ms = one.name, one.utc_ms
        return name

    def _stretches(self, loop: str) -> Iterator[_Stretch]:
        """The names of a loop, the present one first."""
        name, below = loop, len(self._renamings)
        until: int | None = None
        while True:
            # Before the loop came to its name, or after another one gave it away, it was not its.
            at = next(
                (
                    at
                    for at in reversed(range(below))
                    if name in (self._renamings[at].former, self._renamings[at].name)
                ),
                None,
            )
            if at is None:
                yield _Stretch(name, None, until)
                return
            last = self._renamings[at]
            yield _Stretch(name, last.utc_ms, until)
            if last.name != name:
                return
            name, below, until = last.former, at, last.utc_ms
