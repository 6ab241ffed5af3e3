"""``loops.csv`` and ``loops.parquet``: the ranked rows, a part at a time; and ``notes.csv``."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from fieldlink.assess.errors import AssessError
from fieldlink.assess.run_file import RunFile
from fieldlink.assess.table_row import COLUMNS, NUMBERS
from fieldlink.spreadsheet import to_cell
from fieldlink.unfinished_file import remove_unfinished

__all__ = ["require_parquet", "write_tables"]

TOGETHER = 10_000
"""Rows of a row group: some megabytes."""


def require_parquet() -> None:
    """Refuse to begin without the library that writes the table at the end.

    Raises:
        AssessError: pyarrow is not installed.
    """
    try:
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise AssessError(
            "fieldlink assess needs pyarrow, which is not installed; install it with "
            "pip install 'fieldlink[assess]'"
        ) from error


def write_tables(run_file: RunFile, out: Path) -> None:
    """Write both tables, and how files were read; the run file is ranked.

    A file is there as a whole or not at all. ``notes.csv`` has a row a loop (file, loop, notes)
    whose file was not plain to read.

    Raises:
        AssessError: a file cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema([(name, _type(name, pa)) for name in COLUMNS])
    targets = [out / "loops.csv", out / "loops.parquet", out / "notes.csv"]
    parts = [target.with_name(target.name + ".part") for target in targets]
    try:
        with (
            parts[0].open("w", newline="", encoding="utf-8") as stream,
            pq.ParquetWriter(parts[1], schema, compression="zstd") as parquet,
        ):
            sheet = csv.writer(stream)
            sheet.writerow(COLUMNS)
            for rows in _batches(run_file.ranked_rows()):
                sheet.writerows([_cell(value) for value in row] for row in rows)
                columns = zip(*rows, strict=True)
                arrays = [
                    pa.array(column, field.type)
                    for column, field in zip(columns, schema, strict=True)
                ]
                parquet.write_batch(pa.record_batch(arrays, schema=schema))
        with parts[2].open("w", newline="", encoding="utf-8") as stream:
            sheet = csv.writer(stream)
            sheet.writerow(("file", "loop", "notes"))
            sheet.writerows([_cell(value) for value in row] for row in run_file.notes())
        for part, target in zip(parts, targets, strict=True):
            part.replace(target)
    except OSError as error:
        raise AssessError(
            f"the tables in {out} cannot be written ({error.strerror}); check the folder and the "
            "free space, and go on with the same command"
        ) from error
    finally:
        for part in parts:
            remove_unfinished(part)


def _batches(rows: Iterator[list[Any]]) -> Iterator[Sequence[list[Any]]]:
    while batch := list(islice(rows, TOGETHER)):
        yield batch


def _type(name: str, pa: Any) -> Any:
    if name in NUMBERS:
        return pa.float64()
    return pa.int64() if name == "samples" else pa.string()


def _cell(value: Any) -> Any:
    return to_cell(value) if isinstance(value, str) else value
