"""Tables of the historian as CSV or Parquet files, a part at a time: no table has to fit in memory.

Times are UTC; a value that is missing or bad is an empty cell or null; documents are JSON text.
Samples without any set-point or mode have no such column, so that the samples of one loop are a
file that ``fieldlink identify`` reads.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqlalchemy import (
    JSON,
    Boolean,
    Column,
    Connection,
    Float,
    Integer,
    Select,
    Table,
    select,
)

from fieldlink.spreadsheet import to_cell
from fieldlink.store.database import shown
from fieldlink.store.errors import StoreError
from fieldlink.store.reading import reading
from fieldlink.store.schema import (
    AVERAGES,
    DIAGNOSES,
    ESTIMATES,
    EVENTS,
    FINDINGS,
    SAMPLES,
    SLOTS,
    WORK,
    WRITEBACKS,
)
from fieldlink.unfinished_file import remove_unfinished

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["EXPORTED_TABLES", "Export", "export"]

EXPORTED_TABLES = {
    table.name: table
    for table in (
        SAMPLES,
        AVERAGES,
        SLOTS,
        ESTIMATES,
        WRITEBACKS,
        EVENTS,
        WORK,
        DIAGNOSES,
        FINDINGS,
    )
}

PART = 20_000
"""Rows read and written at a time."""


@dataclass(frozen=True, slots=True)
class Export:
    """A finished file and its rows."""

    file: Path
    rows: int


def export(
    url: str,
    target: Path,
    *,
    table: str = "samples",
    loop: str | None = None,
    since: datetime | None = None,
    until: datetime | None = None,
    overwrite: bool = False,
) -> Export:
    """Write a table of the historian to ``target``, whose ending .csv or .parquet decides.

    Args:
        url: the historian.
        target: the new file.
        table: one of `EXPORTED_TABLES`.
        loop: only this loop; all loops (or a table without loops) when None.
        since, until: first and last moment, both included, with a time zone.
        overwrite: replace a file that exists.

    Raises:
        StoreError: unknown ending or table, nothing to export, file exists or cannot be written.
    """
    writer = {".csv": _write_csv, ".parquet": _write_parquet}.get(target.suffix.lower())
    if writer is None:
        raise StoreError(f"{target}: unknown kind of file; end it in .csv or .parquet")
    if table not in EXPORTED_TABLES:
        raise StoreError(f"no table {table!r}; name one of {', '.join(EXPORTED_TABLES)}")
    if os.path.exists(target) and not overwrite:
        raise StoreError(f"{target} exists; name a new file, or replace it with --force")
    chosen = EXPORTED_TABLES[table]
    query = _query(chosen, loop, since, until)
    part = target.with_name(target.name + ".part")
    try:
        with reading(url) as connection:
            columns = _columns(connection, query, chosen)
            parts = connection.execution_options(yield_per=PART).execute(query).partitions()
            rows = writer(part, columns, (_rows(columns, items) for items in parts))
        if rows == 0:
            raise StoreError(
                f"{shown(url)} has nothing of that in {table}"
                + (f" for loop {loop}" if loop is not None else "")
                + "; check the loop's name and the times"
            )
        part.replace(target)
    except OSError as error:
        raise StoreError(
            f"{target} cannot be written: {error.strerror or error}; "
            "check the folder and the free space"
        ) from error
    finally:
        remove_unfinished(part)
    return Export(target, rows)


def _query(
    table: Table, loop: str | None, since: datetime | None, until: datetime | None
) -> Select[Any]:
    query = select(table).order_by(table.c.utc_ms, table.c.id)
    if loop is not None:
        if "loop" not in table.c:
            raise StoreError(f"{table.name} are not a loop's; leave --loop out")
        query = query.where(table.c.loop == loop)
    if since is not None:
        query = query.where(table.c.utc_ms >= round(1000.0 * since.timestamp()))
    if until is not None:
        query = query.where(table.c.utc_ms <= round(1000.0 * until.timestamp()))
    return query


def _columns(connection: Connection, query: Select[Any], table: Table) -> list[Column[Any]]:
    """The columns of the file behind its ``time``."""
    rows = query.order_by(None).subquery()
    absent = {
        name
        for name in ("sp", "auto")
        if table is SAMPLES
        and connection.execute(select(rows.c.id).where(rows.c[name].is_not(None)).limit(1)).first()
        is None
    }
    return [column for column in table.c if column.name not in {"id", "utc_ms", *absent}]


def _rows(columns: Sequence[Column[Any]], items: Iterable[Any]) -> Iterator[list[Any]]:
    for item in items:
        row = item._mapping
        yield [
            row["utc_ms"],
            *(
                json.dumps(row[column.name])
                if isinstance(column.type, JSON) and row[column.name] is not None
                else row[column.name]
                for column in columns
            ),
        ]


def _write_csv(
    file: Path, columns: Sequence[Column[Any]], parts: Iterable[Iterable[Sequence[Any]]]
) -> int:
    count = 0
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["time", *(column.name for column in columns)])
        for part in parts:
            for row in part:
                writer.writerow([_iso(row[0]), *(_cell(value) for value in row[1:])])
                count += 1
    return count


def _iso(utc_ms: int) -> str:
    moment = datetime.fromtimestamp(utc_ms / 1000.0, UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{utc_ms % 1000:03d}Z"


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        return to_cell(value)
    return int(value) if isinstance(value, bool) else value


def _write_parquet(
    file: Path, columns: Sequence[Column[Any]], parts: Iterable[Iterable[Sequence[Any]]]
) -> int:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise StoreError(
            "Parquet files need pyarrow; pip install 'fieldlink[parquet]', or export to .csv"
        ) from error
    schema = pa.schema(
        [("time", pa.timestamp("ms", "UTC")), *((c.name, _arrow_type(c)) for c in columns)]
    )
    count = 0
    with pq.ParquetWriter(file, schema, compression="zstd") as writer:
        for part in parts:
            signals = zip(*part, strict=True)
            arrays = [
                pa.array(signal, field.type) for signal, field in zip(signals, schema, strict=True)
            ]
            writer.write_batch(pa.record_batch(arrays, schema=schema))
            count += len(arrays[0])
    return count


def _arrow_type(column: Column[Any]) -> pa.DataType:
    import pyarrow as pa

    if isinstance(column.type, Boolean):
        return pa.bool_()
    if isinstance(column.type, Integer):
        return pa.int64()
    return pa.float64() if isinstance(column.type, Float) else pa.string()
