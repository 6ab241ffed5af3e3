"""Reading the historian: each table as a pandas frame.

Every frame has the table's columns with ``utc_ms`` replaced by ``time`` (UTC), oldest row first.
All functions take the historian's address, optionally a loop's name, and optionally the first and
the last moment wanted; all raise `StoreError` when there is no historian to read.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any

from sqlalchemy import Column, Float, Table, select

from fieldlink.store.errors import StoreError
from fieldlink.store.reading import reading
from fieldlink.store.schema import AVERAGES, ESTIMATES, EVENTS, SAMPLES, SLOTS, WRITEBACKS

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "frame_of",
    "read_averages",
    "read_estimates",
    "read_events",
    "read_samples",
    "read_slots",
    "read_writebacks",
]


def read_samples(
    url: str,
    loop: str | None = None,
    *,
    since: datetime | None = None,
    until: datetime | None = None,
) -> pd.DataFrame:
    """Return the samples; bad values are NaN."""
    frame = _read(url, SAMPLES, loop, since, until)
    numbers = ["op", "pv", "sp"]
    frame[numbers] = frame[numbers].astype("float64")
    return frame


def read_averages(
    url: str,
    loop: str | None = None,
    *,
    since: datetime | None = None,
    until: datetime | None = None,
) -> pd.DataFrame:
    """Return the averages of samples beyond their retention; ``time`` is the start of each."""
    return _read(url, AVERAGES, loop, since, until)


def read_slots(
    url: str,
    loop: str | None = None,
    *,
    since: datetime | None = None,
    until: datetime | None = None,
) -> pd.DataFrame:
    """Return the accounts of slots; ``time`` is the end of each account."""
    return _read(url, SLOTS, loop, since, until)


def read_estimates(
    url: str,
    loop: str | None = None,
    *,
    since: datetime | None = None,
    until: datetime | None = None,
) -> pd.DataFrame:
    """Return the estimates; ``document`` holds the estimator's whole result as a dictionary."""
    return _read(url, ESTIMATES, loop, since, until)


def read_writebacks(
    url: str,
    loop: str | None = None,
    *,
    since: datetime | None = None,
    until: datetime | None = None,
) -> pd.DataFrame:
    """Return the write-back attempts and decisions."""
    return _read(url, WRITEBACKS, loop, since, until)


def read_events(
    url: str, *, since: datetime | None = None, until: datetime | None = None
) -> pd.DataFrame:
    """Return the events of the daemon, its devices and the store."""
    return _read(url, EVENTS, None, since, until)


def _read(
    url: str, table: Table, loop: str | None, since: datetime | None, until: datetime | None
) -> pd.DataFrame:
    query = select(table).order_by(table.c.utc_ms, table.c.id)
    if loop is not None:
        query = query.where(table.c.loop == loop)
    if since is not None:
        query = query.where(table.c.utc_ms >= _milliseconds(since))
    if until is not None:
        query = query.where(table.c.utc_ms <= _milliseconds(until))
    with reading(url) as connection:
        result = connection.execute(query)
        frame = frame_of(result.mappings().all(), list(table.columns))
    return frame.drop(columns="id")


def frame_of(rows: Sequence[Any], columns: Sequence[Column[Any]]) -> pd.DataFrame:
    """Return rows (mappings) as a frame whose first column ``time`` stands for ``utc_ms``.

    Columns of numbers hold NaN where the store has no value, also where it has none at all.
    """
    # Here, because a daemon that only writes needs no pandas.
    import pandas as pd

    frame = pd.DataFrame(rows, columns=[column.name for column in columns])
    # pandas takes a column of nothing but None for one of objects.
    frame = frame.astype({each.name: float for each in columns if isinstance(each.type, Float)})
    frame.insert(0, "time", pd.to_datetime(frame.pop("utc_ms"), unit="ms", utc=True))
    return frame


def _milliseconds(moment: datetime) -> int:
    if moment.tzinfo is None:
        raise StoreError(f"{moment} has no time zone; give one, such as datetime.now(UTC)")
    return round(moment.timestamp() * 1000.0)
