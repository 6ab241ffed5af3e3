"""Readers of the published collections of industrial loops.

* The International Stiction Data Base of Jelali and Huang (2010) comes as one MATLAB file with a
  structure ``cdata.chemicals.loop10`` that holds ``PV``, ``OP``, ``SP``, ``Ts`` and ``comments``.
* The SACAC collection comes as CSV files: semicolons, a header in any case and order, columns that
  nobody needs, now and then bare carriage returns, and a time column that is not a clock.

Neither collection is part of this project: this module reads them where the files are.
"""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fieldlink.assess.readers.isdb import ReaderError, RecordedLoop, isdb_loops, read_isdb

__all__ = ["ReaderError", "RecordedLoop", "isdb_loops", "read_isdb", "read_sacac"]

Array = NDArray[np.float64]


def _key(header: str) -> str:
    """``"  Op (%)"`` becomes ``"op"``."""
    words = re.findall(r"[a-z]+", header.lower())
    return words[0] if words else ""


def read_sacac(path: str | Path, *, period_s: float | None = None) -> RecordedLoop:
    """Read a SACAC file; its time column is not used, ``period_s`` is taken as given.

    Columns are found by the first word of their header (op, pv, sp, in any case and order). An
    empty cell or a word for nothing (nan, bad, null) becomes NaN.

    Raises:
        ReaderError: no OP or PV column, two of one name, or text where a number belongs.
    """
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        text = path.read_bytes().decode("latin-1")
    lines = [line for line in re.split(r"\r\n|\r|\n", text) if line.strip()]
    if len(lines) < 2:
        raise ReaderError(f"{path}: no rows under a header")
    delimiter = max(";\t,", key=lines[0].count)
    rows = list(csv.reader(lines, delimiter=delimiter, skipinitialspace=True))
    keys = [_key(cell) for cell in rows[0]]
    columns: dict[str, Array] = {}
    for wanted in ("op", "pv", "sp"):
        places = [i for i, key in enumerate(keys) if key == wanted]
        if len(places) > 1:
            raise ReaderError(f"{path}: columns {places} are both named {wanted.upper()!r}")
        if places:
            columns[wanted] = np.array(
                [
                    _number(path, number, wanted, row, places[0], delimiter)
                    for number, row in enumerate(rows[1:], start=2)
                ]
            )
        elif wanted != "sp":
            raise ReaderError(f"{path}: no column {wanted.upper()!r} in the header {rows[0]}")
    return RecordedLoop(
        path.stem, columns["op"], columns["pv"], columns.get("sp"), period_s, comments=""
    )


def _number(
    path: Path, row_number: int, column: str, row: list[str], place: int, delimiter: str
) -> float:
    cell = row[place].strip() if place < len(row) else ""
    if cell.lower() in {"", "nan", "bad", "null", "-"}:
        return math.nan
    try:
        return float(cell.replace(",", ".") if delimiter != "," else cell)
    except ValueError as error:
        raise ReaderError(
            f"{path}: row {row_number}, column {column.upper()!r}: {cell!r} is not a number; "
            f"leave the cell empty when there is no sample"
        ) from error
