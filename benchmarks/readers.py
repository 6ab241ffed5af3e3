"""Readers of the published collections of industrial loops.

* The International Stiction Data Base of Jelali and Huang (2010) comes as one MATLAB file with a
  structure ``cdata.chemicals.loop10`` that holds ``PV``, ``OP``, ``SP``, ``Ts`` and ``comments``.
* The SACAC collection comes as CSV files: semicolons, a header in any case and order, columns that
  nobody needs, now and then bare carriage returns, and a time column that is no clock.

Neither collection is part of this project: whoever has the files reads them with this module.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

__all__ = ["ReaderError", "RecordedLoop", "isdb_loops", "read_isdb", "read_sacac"]

Array = NDArray[np.float64]


class ReaderError(ValueError):
    """A file is not what its reader expects; the message names file, place, value and remedy."""


@dataclass(frozen=True, slots=True)
class RecordedLoop:
    """A recorded loop.

    Attributes:
        name: where it comes from.
        op, pv: samples, shape ``(n,)``, NaN where the file has none.
        sp: set-point, or None when the file has none.
        period_s: seconds between samples, or None when the file does not say.
        comments: what the file says about the loop.
    """

    name: str
    op: Array
    pv: Array
    sp: Array | None
    period_s: float | None
    comments: str


def _structure(path: Path) -> Mapping[str, Any]:
    try:
        contents = loadmat(path, simplify_cells=True)
    except NotImplementedError as error:
        raise ReaderError(
            f"{path}: this is a MATLAB 7.3 (HDF5) file; save it again in MATLAB with -v7"
        ) from error
    except (ValueError, OSError, MatReadError) as error:
        raise ReaderError(f"{path}: not a MATLAB file ({error})") from error
    cdata = contents.get("cdata")
    if not isinstance(cdata, Mapping):
        names = [name for name in contents if not name.startswith("__")]
        raise ReaderError(f"{path}: no structure 'cdata' (the file holds {names})")
    return cdata


def isdb_loops(path: str | Path) -> tuple[str, ...]:
    """Names of all loops in the file, e.g. ``"chemicals.loop10"``."""
    cdata = _structure(Path(path))
    return tuple(
        f"{area}.{loop}"
        for area, loops in cdata.items()
        if isinstance(loops, Mapping)
        for loop in loops
    )


def read_isdb(path: str | Path, loop: str) -> RecordedLoop:
    """Read one loop, e.g. ``read_isdb("isdb10.mat", "chemicals.loop10")``.

    Raises:
        ReaderError: the file, the loop or one of its fields is missing or malformed.
    """
    path = Path(path)
    area, _, name = loop.partition(".")
    loops = _structure(path).get(area)
    record = loops.get(name) if isinstance(loops, Mapping) else None
    if not isinstance(record, Mapping):
        raise ReaderError(f"{path}: no loop {loop!r}; there are {', '.join(isdb_loops(path))}")
    fields = {key.lower(): value for key, value in record.items()}

    def signal(key: str) -> Array | None:
        if key not in fields or np.size(fields[key]) == 0:
            return None
        try:
            return np.asarray(fields[key], dtype=np.float64).ravel()
        except (TypeError, ValueError) as error:
            raise ReaderError(f"{path}: cdata.{loop}.{key.upper()} is not numeric") from error

    op, pv, sp, period = signal("op"), signal("pv"), signal("sp"), signal("ts")
    if op is None or pv is None or op.size != pv.size:
        sizes = [None if s is None else s.size for s in (op, pv)]
        raise ReaderError(f"{path}: cdata.{loop} needs OP and PV of one length; it has {sizes}")
    if sp is not None and sp.size != pv.size:
        sp = np.full(pv.size, sp[0]) if sp.size == 1 else None
    seconds = float(period[0]) if period is not None else math.nan
    comments = fields.get("comments", "")
    return RecordedLoop(
        name=loop,
        op=op,
        pv=pv,
        sp=sp,
        period_s=seconds if math.isfinite(seconds) and seconds > 0.0 else None,
        comments=" ".join(str(part).strip() for part in np.atleast_1d(comments)).strip(),
    )


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
            f"{path}: row {row_number}, column {column.upper()!r}: {cell!r} is no number; "
            f"leave the cell empty when there is no sample"
        ) from error
