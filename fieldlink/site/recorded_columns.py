"""The columns of a recording: which is which signal, and cells as numbers, modes and times."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.column_names import guess_columns
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
    """Finds and converts the columns of a file.

    Attributes:
        problems: what is wrong.
        notes: what was taken for what, for a person to agree or not.
    """

    def __init__(self, file: CsvFile, needed: tuple[str, ...] = ("op", "pv")) -> None:
        self._file = file
        self._needed = needed
        self._unsure: frozenset[str] = frozenset()
        self._several: set[str] = set()
        self.problems: list[Problem] = []
        self.notes: list[str] = []

    def report(self, column: str, message: str, remedy: str, line: int | None = None) -> None:
        """Add a problem."""
        self.problems.append(Problem(str(self._file.path), column, message, remedy, line))

    def find_all(self, wanted: Mapping[str, str | None]) -> dict[str, int | None]:
        """Return the number of each role's column, None for one that is not there.

        What was named has to be there; the needed ones have to be there in any case.
        """
        found = {role: self._find(role, name) for role, name in wanted.items()}
        known = {role: number for role, number in found.items() if number is not None}
        asked = {role for role, name in wanted.items() if name is not None}
        guess = guess_columns(self._file.header, known)
        header = self._file.header
        guessed = {
            role: number
            for role, number in guess.columns.items()
            if role not in known and role not in asked and role not in self._several
        }
        self._unsure = guess.unsure & guessed.keys()
        for role, names in guess.ambiguous.items():
            if role not in asked and role not in self._several:
                self.report(
                    role,
                    f"several columns may be meant: {', '.join(names)}",
                    f"choose one with --{role} {names[0]!r}",
                    self._file.header_line,
                )
        missing = [role for role in self._needed if role not in known.keys() | guessed.keys()]
        for role in missing:
            if role not in asked and role not in guess.ambiguous and role not in self._several:
                self._report_missing(role, role, is_named=False)
        if guessed:
            taken = ", ".join(f"{role} is {header[number]!r}" for role, number in guessed.items())
            self.notes.append(f"columns taken by their names: {taken}")
        return found | guessed

    def is_guessed(self, role: str) -> bool:
        """Whether a role's column was taken by a name that means it only vaguely."""
        return role in self._unsure

    def _find(self, role: str, name: str | None) -> int | None:
        """Return the number of the column of exactly this name; a missing one is named wrongly."""
        header = self._file.header
        wanted = role if name is None else name
        exact = [number for number, column in enumerate(header) if column == wanted]
        folded = [n for n, column in enumerate(header) if column.lower() == wanted.strip().lower()]
        matches = exact or folded
        if len(matches) > 1:
            self._several.add(role)
            shown = ", ".join(header[number] for number in matches)
            self.report(
                wanted,
                f"several columns match: {shown}",
                "give the one that is meant by its exact name",
                self._file.header_line,
            )
        elif not matches and name is not None:
            self._report_missing(role, wanted, is_named=True)
        return matches[0] if len(matches) == 1 else None

    def _report_missing(self, role: str, wanted: str, *, is_named: bool) -> None:
        header, line = self._file.header, self._file.header_line
        if all(map(_is_number, header)):
            if role == "op":
                self.report("", "the first row holds numbers, no names", "add a row op,pv", line)
            else:
                self.report(wanted, "no column of that name", "add a row of column names", line)
            return
        remedy = nearest(wanted, header)
        if not is_named:
            remedy += f", or say which column is {role}"
        self.report(wanted, "no column of that name", remedy, line)

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
                        f"{cell!r} is not a number",
                        "correct it, or leave the cell empty where the sample is bad",
                        row.line,
                    )
        if wrong > _MAX_PROBLEMS:
            self._report_more(column, wrong - _MAX_PROBLEMS)
        elif not wrong and values.size and np.isnan(values).all():
            name = self._file.header[column]
            self.report(name, "holds no number at all", "choose another column")
        return values

    def switch(self, column: int | None, *, is_guessed: bool = False) -> NDArray[np.bool_] | None:
        """Return a column of yes and no; an empty cell is no.

        A column that is only guessed to be one counts when it holds words: of a number alone it is
        not known which mode it means.
        """
        if column is None:
            return None
        if is_guessed and any(
            row.cells[column].lower() not in _BAD | _TRUE | _FALSE for row in self._file.rows
        ):
            name = self._file.header[column]
            self.notes.append(f"{name} is left out: name it with --auto if 1 means automatic there")
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

    def sampling(self, column: int | None, *, is_guessed: bool = False) -> Sampling | None:
        """Return what the time column says; nothing where a guessed one holds no time."""
        if column is None:
            return None
        name = self._file.header[column]
        cells = [row.cells[column] for row in self._file.rows]
        remedy = "correct it, or give the seconds between rows with --period"
        try:
            return sampling_of(parse_times(cells, self._file.number))
        except NoClockError as error:
            if is_guessed:
                self.notes.append(f"{name} is left out: {error}")
                return None
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
