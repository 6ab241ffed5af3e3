"""Samples of a historian read a stretch at a time, over one connection: for readers of all samples.

Loops and their first and last sample are found by the table's index, so that a historian of a year
is not read to find out what is in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Select, func, select
from sqlalchemy.exc import SQLAlchemyError

from fieldlink.store.database import open_for_reading, shown
from fieldlink.store.errors import StoreError
from fieldlink.store.reading import reading_error
from fieldlink.store.schema import SAMPLES

__all__ = ["SampleReader", "column_of_numbers"]

Floats = NDArray[np.float64]


class SampleReader:
    """Reads the samples of one historian; `close` it when done.

    Raises:
        StoreError: there is no such historian; its methods raise it when it cannot be read, and
            `StoreAwayError` when its server does not answer.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        self._engine = open_for_reading(url)

    def close(self) -> None:
        """Give the connection back."""
        self._engine.dispose()

    def loops(self) -> Iterator[str]:
        """Yield the names of all loops with samples, in order."""
        name = ""
        while True:
            query = select(func.min(SAMPLES.c.loop)).where(SAMPLES.c.loop > name)
            found = self._rows(query)[0][0]
            if found is None:
                return
            name = str(found)
            yield name

    def span(self, loop: str) -> tuple[int, int]:
        """Return the stamps of a loop's first and last sample, UTC milliseconds since 1970.

        Raises:
            StoreError: the loop has no samples.
        """
        first, last = (
            self._rows(select(function(SAMPLES.c.utc_ms)).where(SAMPLES.c.loop == loop))[0][0]
            for function in (func.min, func.max)
        )
        if first is None or last is None:
            raise StoreError(
                f"the historian {shown(self._url)} has no samples of loop {loop!r}; check the name"
            )
        return int(first), int(last)

    def stretch(self, loop: str, since_ms: int, until_ms: int, rows: int) -> dict[str, Floats]:
        """Return at most ``rows`` samples from ``since_ms`` on and before ``until_ms``.

        Columns are ``utc_ms``, ``slot``, ``op``, ``pv``, ``sp`` and ``auto``, each of shape
        ``(n,)``, oldest first, NaN where the historian has nothing.
        """
        names = ("utc_ms", "slot", "op", "pv", "sp", "auto")
        query = (
            select(*(SAMPLES.c[name] for name in names))
            .where(SAMPLES.c.loop == loop)
            .where(SAMPLES.c.utc_ms >= since_ms)
            .where(SAMPLES.c.utc_ms < until_ms)
            .order_by(SAMPLES.c.utc_ms, SAMPLES.c.id)
            .limit(rows)
        )
        found = self._rows(query)
        return {name: column_of_numbers(found, number) for number, name in enumerate(names)}

    def _rows(self, query: Select[Any]) -> Sequence[Any]:
        try:
            with self._engine.connect() as connection:
                return connection.execute(query).all()
        except SQLAlchemyError as error:
            raise reading_error(self._engine, self._url, error) from error


def column_of_numbers(rows: Sequence[Any], number: int) -> Floats:
    """Return one column of the rows of a query, NaN for NULL."""
    return np.array([np.nan if row[number] is None else row[number] for row in rows], dtype=float)
