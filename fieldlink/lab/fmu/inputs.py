"""Recorded inputs: a CSV file with a column ``time`` and one column for each tag or variable.

What spreadsheets write is taken: a comma, semicolon, tab or bar between the cells, UTF-8, UTF-16 or
Windows text, and numbers as in recordings (`fieldlink.site.number_cells`).
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fieldlink.lab.fmu.errors import FmuError, nearest
from fieldlink.lab.fmu.recorder import TIME_VARIABLE
from fieldlink.site.csv_file import read_text
from fieldlink.site.errors import RecordingError
from fieldlink.site.number_cells import find_decimal_mark, parse_numbers

__all__ = ["InputSeries", "read_inputs"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class InputSeries:
    """Values that hold from their moment on; before the first moment the first value holds.

    Attributes:
        time: seconds of the experiment, never decreasing, shape ``(n,)``. Of rows of one moment the
            last holds.
        columns: values by tag, each of shape ``(n,)``.
    """

    time: Array
    columns: Mapping[str, Array]

    def at(self, moments: Array) -> dict[str, Array]:
        """Return every column at ``moments``."""
        # A moment that is late by rounding only takes the value that begins there.
        slack = 1e-9 * np.maximum(1.0, np.abs(moments))
        rows = np.searchsorted(self.time, moments + slack, side="right") - 1
        return {name: values[np.maximum(rows, 0)] for name, values in self.columns.items()}


_DELIMITERS = ",;\t|"
_NO_WORDS: Mapping[str, Mapping[str, float]] = MappingProxyType({})


def read_inputs(
    file: Path, known: Iterable[str], words: Mapping[str, Mapping[str, float]] = _NO_WORDS
) -> InputSeries:
    """Read the inputs of an experiment.

    Args:
        file: CSV with a header.
        known: names that a column may have.
        words: by column, the words that stand for values, such as those of an enumeration.

    Raises:
        FmuError: unreadable, no column ``time``, an unknown column, a cell that is not a number, or
            time that decreases; row and column are named.
    """
    header, rows, comma_separates = _read_cells(file)
    if "time" not in header:
        like = [name for name in header if re.match(r"(?i)(t|time|zeit|seconds|s)\b", name)]
        hint = f"; is it {like[0]!r}? Call it time, and give seconds" if like else ""
        raise FmuError(
            f"{file}: there is no column 'time' (seconds of the experiment); the columns are "
            f"{', '.join(header)}{hint}"
        )
    twice = next((name for k, name in enumerate(header) if name in header[:k]), None)
    if twice is not None:
        raise FmuError(f"{file}: there are two columns {twice!r}; leave one out")
    names = {TIME_VARIABLE if name == "time" else name for name in known}
    columns: dict[str, Array] = {}
    for k, name in enumerate(header):
        tag = "time" if name == TIME_VARIABLE else name
        if name != "time" and name not in names:
            raise FmuError(f"{file}: column {name!r} is not an input; {nearest(name, names)}")
        known_words = {} if name == "time" else words.get(tag, {})
        values = _numbers(file, header, rows, k, known_words, comma_separates=comma_separates)
        if name == "time":
            time = values
        else:
            columns[tag] = values
    if time.size == 0:
        raise FmuError(f"{file}: there is no row below the header")
    wrong = np.flatnonzero(np.diff(time) < 0.0)
    if wrong.size:
        row = int(wrong[0])
        raise FmuError(
            f"{file}: time must not decrease; row {row + 3} has {time[row + 1]:g} after "
            f"{time[row]:g}; sort the rows"
        )
    return InputSeries(time, columns)


def _read_cells(file: Path) -> tuple[list[str], list[list[str]], bool]:
    """Return header, rows, and whether commas stand between the cells."""
    try:
        lines = read_text(file, RecordingError, pipe=True).splitlines()
    except RecordingError as error:
        raise FmuError(str(error)) from error
    if not lines:
        raise FmuError(f"{file}: it is empty; give a header and rows")
    delimiter = max(_DELIMITERS, key=lines[0].count)
    try:
        rows = [
            [cell.strip() for cell in row]
            for row in csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
        ]
    except csv.Error as error:
        raise FmuError(f"{file}: the inputs are not CSV: {error}") from error
    header = rows[0]
    for number, row in enumerate(rows[1:], start=2):
        if row and len(row) != len(header):
            raise FmuError(
                f"{file}: row {number} has {len(row)} cells, the header has {len(header)}"
            )
    return header, [row for row in rows[1:] if row], delimiter == ","


def _numbers(
    file: Path,
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    number: int,
    words: Mapping[str, float],
    *,
    comma_separates: bool,
) -> Array:
    """Return a column's values, in the notation of the other columns where it shows none."""
    name = header[number]
    plain = {word.lower(): value for word, value in words.items()}
    cells = [row[number] for row in rows]
    is_word = [cell.lower() in plain for cell in cells]

    def proven() -> str | None:
        others = (n for n in range(len(header)) if n != number)
        marks = {find_decimal_mark(row[n] for row in rows) for n in others} - {None}
        return marks.pop() if len(marks) == 1 else None

    digits = ["0" if known else cell for cell, known in zip(cells, is_word, strict=True)]
    found = parse_numbers(digits, comma_separates=comma_separates, proven=proven)
    if found.ambiguous is not None:
        raise FmuError(
            f"{file}: column {name!r}: {found.ambiguous!r} may be a decimal comma or grouped "
            "digits; write it with a decimal point between commas, or without groups of digits"
        )
    values = found.values
    for row, cell in enumerate(cells):
        if is_word[row]:
            values[row] = plain[cell.lower()]
        elif not math.isfinite(values[row]) or (found.unit and cell.endswith(found.unit)):
            shown = repr(cell) if cell else "an empty cell"
            hint = f" and none of {', '.join(words)}" if words else ""
            if name == "time":
                hint = "; give seconds of the run, such as 0 and 10"
            raise FmuError(
                f"{file}: row {row + 2}, column {name!r}: {shown} is not a finite number{hint}"
            )
    return values
