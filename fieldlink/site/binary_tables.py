"""Recordings that are not text: Excel workbooks, Parquet and MATLAB files, as rows of text cells.

    read_binary_table(Path("loop.mat"))  # rows, the first of which holds the names; None for text

A MATLAB file has a vector for each signal, at its top or in a structure, or one matrix, whose
columns are ``column1``, ``column2`` and so on; it may have the seconds between samples as ``Ts``.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterable, Mapping
from datetime import date, datetime, time
from pathlib import Path
from typing import Any

import numpy as np

from fieldlink.site.column_names import PANDAS_INDEX, guess_columns
from fieldlink.site.csv_file import CsvRow
from fieldlink.site.errors import Problem, RecordingError
from fieldlink.site.workbooks import OLE, explained_workbook, why_no_xlsx

__all__ = ["MIN_ROWS", "read_binary_table"]

_PERIODS = ("ts", "dt", "period", "sampletime", "samplingtime", "sampling_period")
"""Names of a MATLAB scalar that is the seconds between samples."""

MIN_ROWS = 50
"""Fewer rows hold too little of an oscillation to judge."""


def read_binary_table(path: Path) -> list[CsvRow] | None:
    """Return the rows of a workbook, Parquet or MATLAB file; None for any other file.

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
        return _parquet(path)
    if begin.startswith(b"MATLAB") or path.suffix.lower() == ".mat":
        return _matlab(path)
    if begin.startswith(OLE) and (found := why_no_xlsx(path)) is not None:
        raise _refusal(path, *found)
    return None


def _excel(path: Path) -> list[CsvRow]:
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
            return found
        finally:
            book.close()


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


def _matlab(path: Path) -> list[CsvRow]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        found = loadmat(path, simplify_cells=True)
    except NotImplementedError as error:
        what = "is a MATLAB 7.3 (HDF5) file"
        raise _refusal(path, what, "save it again in MATLAB with -v7") from error
    except (ValueError, TypeError, LookupError, OSError, MatReadError, zlib.error) as error:
        raise _refusal(path, "is not a MATLAB file that can be read", "save it again") from error
    named = {name: _full(value) for name, value in found.items() if not name.startswith("__")}
    if "cdata" in named:
        what = "is the International Stiction Data Base, which holds many loops"
        raise _refusal(path, what, "judge all of them with fieldlink assess")
    structures = [value for value in named.values() if isinstance(value, Mapping)]
    if len(structures) == 1 and len(named) == 1:
        named = {name: _full(value) for name, value in structures[0].items()}
    vectors = {name: np.ravel(value) for name, value in named.items() if _is_vector(value)}
    matrices = [np.asarray(value) for value in named.values() if _is_matrix(value)]
    if not vectors and len(matrices) == 1:
        tall = matrices[0] if matrices[0].shape[0] >= matrices[0].shape[1] else matrices[0].T
        vectors = {f"column{at}": column for at, column in enumerate(tall.T, start=1)}
    longest = max((vector.size for vector in vectors.values()), default=0)
    columns: dict[str, Iterable[Any]] = {
        name: vector.tolist() for name, vector in vectors.items() if vector.size == longest
    }
    odd = [
        f"{name} is {_words_of(value)}"
        for name, value in named.items()
        if name.lower() in ("op", "pv") and name not in columns
    ]
    if odd:
        what = f"{' and '.join(odd)}{f', and other signals have {longest}' if columns else ''}"
        raise _refusal(path, what, "save op and pv as vectors of real numbers, of one length")
    if len(structures) > 1 and not columns:
        what = f"holds {len(structures)} structures, {', '.join(named)}"
        raise _refusal(path, what, "save one in a file, with the vectors op and pv")
    if longest < 2:
        what = f"has no vectors of samples (it holds {', '.join(named) or 'nothing'})"
        remedy = "save vectors op and pv or one matrix, and the seconds between samples as Ts"
        raise _refusal(path, what, remedy)
    periods = [v for name, v in named.items() if name.lower() in _PERIODS and np.size(v) == 1]
    if len(periods) == 1 and not any(name.lower() in ("time", "t") for name in columns):
        columns["time"] = _times(np.ravel(periods[0])[0], longest)
    return _rows(columns)


def _times(period: Any, count: int) -> list[Any]:
    """Return the times of samples, or the period itself in every row if it is no length of time.

    The rows are refused then. Simulink has 0 and -1 for models without a sample time of their own.
    """
    if np.asarray(period).dtype.kind not in "fiu" or not 0.0 < period < np.inf:
        return [period] * count
    times: list[Any] = (np.arange(count) * float(period)).tolist()
    return times


def _is_vector(value: Any) -> bool:
    array = np.asarray(value)
    return array.dtype.kind in "bfiu" and array.size > 1 and array.size == max(array.shape)


def _full(value: Any) -> Any:
    """A value as an array where MATLAB has stored it sparse."""
    return value.toarray() if hasattr(value, "toarray") else value


def _words_of(value: Any) -> str:
    """What a signal is that is not a vector of samples."""
    array = np.asarray(value)
    if array.dtype.kind == "c":
        return "complex"
    if array.dtype.kind not in "bfiu":
        return "no array of numbers"
    if array.size <= 1:
        return "one number" if array.size else "empty"
    if _is_vector(value):
        return f"a vector of {array.size} samples"
    return f"an array of {' x '.join(map(str, array.shape))}"


def _is_matrix(value: Any) -> bool:
    array = np.asarray(value)
    return array.dtype.kind in "bfiu" and array.ndim == 2 and min(array.shape) > 1


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
