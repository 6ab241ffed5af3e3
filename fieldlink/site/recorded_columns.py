"""The columns of a recorded file: found by name, converted, and what is wrong with them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.csv_file import CsvFile
from fieldlink.site.errors import Problem, nearest
from fieldlink.site.timestamps import NoClockError, Sampling, parse_times, sampling_of

__all__ = ["RecordedColumns"]

_BAD = frozenset({"", "nan", "null", "na", "n/a", "#n/a", "none"})
_TRUE = frozenset({"true", "yes", "on", "auto", "automatic", "cas", "cascade"})
_FALSE = frozenset({"false", "no", "off", "man", "manual"})
_MAX_PROBLEMS = 10

Floats = NDArray[np.float64]


class RecordedColumns:
    """Finds and converts the columns of a file, and collects what is wrong."""

    def __init__(self, file: CsvFile, needed: tuple[str, ...] = ("op", "pv")) -> None:
        self._file = file
        self._needed = needed
        self.problems: list[Problem] = []

    def report(self, column: str, message: str, remedy: str, line: int | None = None) -> None:
        """Collect a problem of the file, or of one of its columns."""
        self.problems.append(Problem(str(self._file.path), column, message, remedy, line))

    def find(self, role: str, name: str | None) -> int | None:
        """Return the number of a column; a missing one is an error if it was named or is needed."""
        header = self._file.header
        wanted = role if name is None else name
        exact = [number for number, column in enumerate(header) if column == wanted]
        folded = [n for n, column in enumerate(header) if column.lower() == wanted.strip().lower()]
        matches = exact or folded
        line = self._file.header_line
        if len(matches) > 1:
            shown = ", ".join(header[number] for number in matches)
            self.report(
                wanted,
                f"several columns match: {shown}",
                "give the one that is meant by its exact name",
                line,
            )
        elif not matches and all(map(_is_number, header)):
            if role == "op":
                self.report("", "the first row holds numbers, no names", "add a row op,pv", line)
            elif role == "pv" or name is not None:
                self.report(wanted, "no column of that name", "add a row of column names", line)
        elif not matches and (name is not None or role in self._needed):
            remedy = nearest(wanted, header)
            if name is None:
                remedy += f", or say which column is {role}"
            self.report(wanted, "no column of that name", remedy, line)
        return matches[0] if len(matches) == 1 else None

    def numbers(self, column: int | None) -> Floats | None:
        """Return a column of numbers, NaN where a cell is empty or marked bad."""
        if column is None:
            return None
        values = np.full(len(self._file.rows), np.nan)
        wrong = 0
        for index, row in enumerate(self._file.rows):
            cell = row.cells[column]
            if cell.lower() in _BAD:
                continue
            try:
                values[index] = self._file.number(cell)
            except ValueError:
                wrong += 1
                if wrong <= _MAX_PROBLEMS:
                    self.report(
                        self._file.header[column],
                        f"{cell!r} is no number",
                        "correct it, or leave the cell empty where the sample is bad",
                        row.line,
                    )
        if wrong > _MAX_PROBLEMS:
            self._report_more(column, wrong - _MAX_PROBLEMS)
        elif not wrong and values.size and np.isnan(values).all():
            name = self._file.header[column]
            self.report(name, "holds no number at all", "choose another column")
        return values

    def switch(self, column: int | None) -> NDArray[np.bool_] | None:
        """Return a column of yes and no; an empty cell is no."""
        if column is None:
            return None
        values = np.zeros(len(self._file.rows), dtype=np.bool_)
        wrong = 0
        for index, row in enumerate(self._file.rows):
            cell = row.cells[column].lower()
            if cell in _BAD or cell in _FALSE:
                continue
            if cell in _TRUE:
                values[index] = True
                continue
            try:
                values[index] = self._file.number(cell) != 0.0
            except ValueError:
                wrong += 1
                if wrong <= _MAX_PROBLEMS:
                    self.report(
                        self._file.header[column],
                        f"{row.cells[column]!r} is neither yes nor no",
                        "write 1 for automatic and 0 for manual",
                        row.line,
                    )
        if wrong > _MAX_PROBLEMS:
            self._report_more(column, wrong - _MAX_PROBLEMS)
        return values

    def sampling(self, column: int | None) -> Sampling | None:
        """Return what the time column says."""
        if column is None:
            return None
        name = self._file.header[column]
        cells = [row.cells[column] for row in self._file.rows]
        remedy = "correct it, or give the seconds between rows with --period"
        try:
            return sampling_of(parse_times(cells, self._file.number))
        except NoClockError as error:
            line = None if error.index is None else self._file.rows[error.index].line
            self.report(name, str(error), remedy, line)
            return None

    def _report_more(self, column: int, count: int) -> None:
        name = self._file.header[column]
        self.report(name, f"{count} more cells are wrong", "is it the right column?")


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True
