"""Recordings that are not text: Excel workbooks, Parquet and MATLAB files, as rows of text cells.

    read_binary_table(Path("loop.mat")).rows  # the first holds the names; of text None comes

What a MATLAB file may hold is in `fieldlink.site.matlab_files`.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import date, datetime, time
from pathlib import Path
from typing import Any

from fieldlink.site.column_names import PANDAS_INDEX, guess_columns
from fieldlink.site.csv_file import CsvRow
from fieldlink.site.errors import Problem, RecordingError
from fieldlink.site.matlab_files import read_matlab_columns
from fieldlink.site.workbooks import OLE, explained_workbook, why_no_xlsx

__all__ = ["MIN_ROWS", "BinaryTable", "read_binary_table"]

MIN_ROWS = 50
"""Fewer rows hold too little of an oscillation to judge."""


@dataclass(frozen=True, slots=True)
class BinaryTable:
    """The rows of a file, and what a person should know of what was not read."""

    rows: list[CsvRow]
    notes: tuple[str, ...] = ()


def read_binary_table(path: Path) -> BinaryTable | None:
    """Return the table of a workbook, Parquet or MATLAB file; None for any other file.

    Raises:
        RecordingError: it cannot be read, holds no table, or its library is not installed.
    """
    if not os.path.isfile(path):
        return None
    try:
        with path.open("rb") as stream:
            begin = stream.read(8)
    except OSError:
        # The reader of text says why.
        return None
    if begin.startswith(b"PK\x03\x04"):
        return _excel(path)
    if begin.startswith(b"PAR1"):
        return BinaryTable(_parquet(path))
    if begin.startswith(b"MATLAB") or path.suffix.lower() == ".mat":
        return BinaryTable(_rows(read_matlab_columns(path)))
    if begin.startswith(OLE) and (found := why_no_xlsx(path)) is not None:
        raise _refusal(path, *found)
    return None


def _excel(path: Path) -> BinaryTable:
    try:
        from openpyxl import load_workbook
    except ImportError as error:
        remedy = "pip install 'fieldlink[excel]', or save it as CSV"
        raise _refusal(path, "is a workbook, which openpyxl reads", remedy) from error
    # From the open file: of a path openpyxl refuses another ending, and the content has decided.
    with explained_workbook(path, RecordingError), path.open("rb") as stream:
        book = load_workbook(stream, read_only=True, data_only=True)
        try:
            if not book.worksheets:
                raise _refusal(path, "has no sheet of cells", "put the samples on the first sheet")
            first, *others = book.worksheets
            rows = first.iter_rows(values_only=True)
            found = [CsvRow(n, tuple(map(_text, row))) for n, row in enumerate(rows, start=1)]
            if len(found) < MIN_ROWS:
                _refuse_cover(path, first.title, len(found), others)
            return BinaryTable(found, _note_of_sheets(first.title, others))
        finally:
            book.close()


def _note_of_sheets(first: str, others: Iterable[Any]) -> tuple[str, ...]:
    """Return a sentence on sheets that are long enough for samples, and are not read."""
    # Some programs do not store how many rows a sheet has.
    more = [repr(sheet.title) for sheet in others if (sheet.max_row or 0) >= MIN_ROWS]
    names = ", ".join(more)
    return (f"the first sheet, {first!r}, is read, and not {names}",) if more else ()


def _refuse_cover(path: Path, first: str, rows: int, others: Iterable[Any]) -> None:
    """Raise where the first sheet is a cover, and the samples are on another one."""
    for sheet in others:
        count = sum(1 for _ in sheet.iter_rows(values_only=True))
        if count >= MIN_ROWS:
            what = (
                f"its first sheet, {first!r}, which is read, has {rows} rows, and {sheet.title!r} "
                f"has {count}"
            )
            raise _refusal(path, what, f"make {sheet.title!r} the first sheet, or save it as CSV")


def _parquet(path: Path) -> list[CsvRow]:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        remedy = "pip install 'fieldlink[assess]', or export it as CSV"
        raise _refusal(path, "is a Parquet file, which pyarrow reads", remedy) from error
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        said = " ".join(str(error).split())
        raise _refusal(path, f"cannot be read as Parquet ({said})", "export it again") from error
    names = list(table.column_names)
    if PANDAS_INDEX in names and "time" not in guess_columns(names, {}).columns:
        at = names.index(PANDAS_INDEX)
        if pa.types.is_timestamp(table.schema.field(at).type):
            names[at] = "time"
    return _rows({name: table.column(at).to_pylist() for at, name in enumerate(names)})


def _rows(columns: Mapping[str, Iterable[Any]]) -> list[CsvRow]:
    header = CsvRow(1, tuple(columns))
    body = zip(*([_text(value) for value in column] for column in columns.values()), strict=True)
    return [header, *(CsvRow(line, cells) for line, cells in enumerate(body, start=2))]


def _text(value: Any) -> str:
    """A cell as a text file would hold it."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "1" if value else "0"
    if isinstance(value, (datetime, date, time)):
        return value.isoformat(" ") if isinstance(value, datetime) else value.isoformat()
    return str(value).strip()


def _refusal(path: Path, what: str, remedy: str) -> RecordingError:
    return RecordingError([Problem(str(path), "", what, remedy)])
