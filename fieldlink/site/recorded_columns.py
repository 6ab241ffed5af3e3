"""The columns of a recording: which is which signal, and cells as numbers, modes and times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.column_names import guess_columns, loops_side_by_side, quality_columns
from fieldlink.site.csv_file import CsvFile
from fieldlink.site.dates_beside_times import join_dates
from fieldlink.site.errors import Problem, nearest, several_loops
from fieldlink.site.number_cells import BAD, NumberCells, parse_numbers
from fieldlink.site.numbered_times import find_time_unit, is_plausible
from fieldlink.site.quality_codes import find_good
from fieldlink.site.recorded_table import holds_values, is_moment
from fieldlink.site.row_order import Rows, put_in_order
from fieldlink.site.times import NoClockError, Times
from fieldlink.site.timestamps import Sampling, parse_times, sampling_of

__all__ = ["RecordedColumns", "is_own_export", "means_automatic"]

_TRUE = frozenset({"true", "yes", "on", "auto", "automatic", "cas", "cascade"})
_FALSE = frozenset({"false", "no", "off", "man", "manual"})
_OWN_EXPORT = frozenset({"loop", "slot", "quality", "late_ms"})
_MAX_PROBLEMS = 10
_WORDS_SHOWN = 3
_LOOKED_AT = 20
"""First rows from which a column of moments is known."""

Floats = NDArray[np.float64]
Columns = Mapping[str, int | None]


def is_own_export(header: Sequence[str]) -> bool:
    """Whether a table is an export of our own historian: there 0 is a good quality."""
    return set(header) >= _OWN_EXPORT


def means_automatic(cell: str) -> bool | None:
    """Whether a word means automatic, False for manual; None for any other text."""
    word = cell.lower()
    return True if word in _TRUE else False if word in _FALSE else None


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
        for role in ("sp", "auto"):
            number = found.get(role)
            if wanted.get(role) is None and number is not None and self._is_empty(number):
                # An export of a loop without the signal has its column nevertheless.
                self.notes.append(f"{self._file.header[number]} is left out: it holds nothing")
                found[role] = None
        known = {role: number for role, number in found.items() if number is not None}
        asked = {role for role, name in wanted.items() if name is not None}
        guess = guess_columns(self._file.header, known)
        header = self._file.header
        if {"op", "pv"} <= asked & known.keys():
            self._note_exchanged(header[known["op"]], header[known["pv"]])
        guessed = {
            role: number
            for role, number in guess.columns.items()
            if role not in known
            and role not in asked
            and role not in self._several
            and not (role in ("sp", "auto") and self._is_empty(number))
        }
        ambiguous = dict(guess.ambiguous)
        times = [n for n, name in enumerate(header) if name in ambiguous.get("time", ())]
        if times and "time" not in asked and self._hold_the_same(times):
            # Historians put a column of moments before each signal.
            guessed["time"] = times[0]
            del ambiguous["time"]
            self.notes.append(f"{len(times)} columns hold the same times: the first one is taken")
        self._unsure = guess.unsure & guessed.keys()
        if not {"time"} & (asked | known.keys() | guessed.keys() | ambiguous.keys()):
            self._find_moments(guessed)
        is_open = not {"op", "pv"} & (asked | known.keys() | self._several)
        if is_open and {"op", "pv"} & ambiguous.keys() and len(loops_side_by_side(header)) > 1:
            self._report_loops_beside()
            return found | guessed
        for role, names in ambiguous.items():
            if role not in asked and role not in self._several:
                remedy = _remedy_of(role, names, f"choose one with --{role} {names[0]!r}")
                message = f"several columns may be meant: {', '.join(names)}"
                self.report(role, message, remedy, self._file.header_line)
        for one, other in combinations(sorted(known), 2):
            if known[one] == known[other]:
                message = f"is meant as {one} and {other} at once"
                remedy = f"name another column with --{one} or --{other}"
                self.report(header[known[one]], message, remedy, self._file.header_line)
        missing = [role for role in self._needed if role not in known.keys() | guessed.keys()]
        for role in missing:
            if role not in asked and role not in ambiguous and role not in self._several:
                self._report_missing(role, role, is_named=False)
        if guess.columns.keys() & guessed.keys():
            taken = ", ".join(
                f"{role} is {header[number]!r}"
                for role, number in guessed.items()
                if role in guess.columns
            )
            self.notes.append(f"columns taken by their names: {taken}")
        return found | guessed

    def _note_exchanged(self, op: str, pv: str) -> None:
        """Say when the two columns that were named are each other's by their headings."""
        header = self._file.header
        plain = {role: header[at] for role, at in guess_columns(header, {}).columns.items()}
        for own in (plain, *loops_side_by_side(header, alone=True).values()):
            if (own.get("op"), own.get("pv")) == (pv, op):
                self.notes.append(
                    f"op is {op!r} and pv is {pv!r}: by their names they are exchanged; if they "
                    "are, exchange --op and --pv"
                )
                return

    def _report_loops_beside(self) -> None:
        """Report loops side by side of which none is meant more than the others."""
        loops = list(loops_side_by_side(self._file.header))
        place, line = str(self._file.path), self._file.header_line
        self.problems.append(several_loops(place, "", loops, line))

    def _is_empty(self, column: int) -> bool:
        return not any(row.cells[column] for row in self._file.rows)

    def _find_moments(self, guessed: dict[str, int]) -> None:
        """Take the only column of dates or times of day for the time, whatever its heading."""
        first = self._file.rows[:_LOOKED_AT]
        moments = [
            number
            for number in range(len(self._file.header))
            if number not in guessed.values() and all(is_moment(row.cells[number]) for row in first)
        ]
        if first and len(moments) == 1 and "time" not in self._several:
            guessed["time"] = moments[0]
            self._unsure |= {"time"}
            name = self._file.header[moments[0]]
            column = f"column {name!r}" if name else "the column without a heading"
            self.notes.append(f"{column} holds dates or times of day: taken for the time")

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
        if len(matches) > 1 and self._hold_the_same(matches):
            matches = matches[:1]
        if len(matches) > 1:
            self._several.add(role)
            names = [header[number] for number in matches]
            remedy = _remedy_of(role, names, "give the one that is meant by its exact name")
            message = f"several columns match: {', '.join(names)}"
            self.report(wanted, message, remedy, self._file.header_line)
        elif not matches and name is not None:
            self._report_missing(role, wanted, is_named=True)
        return matches[0] if len(matches) == 1 else None

    def _hold_the_same(self, columns: list[int]) -> bool:
        first, *others = columns
        return all(
            row.cells[first] == row.cells[other] for row in self._file.rows for other in others
        )

    def _report_missing(self, role: str, wanted: str, *, is_named: bool) -> None:
        header, line = self._file.header, self._file.header_line
        if holds_values(header):
            if not any(problem.line == line for problem in self.problems):
                remedy = "add a row of column names above it, such as time,op,pv"
                self.report("", "the first row holds values, no names", remedy, line)
            return
        remedy = nearest(wanted, header)
        if not is_named:
            remedy += f"; call it {role}, or choose it with --{role} (identify, diagnose, assess)"
        self.report(wanted, "no column of that name", remedy, line)

    def numbers(self, column: int | None) -> Floats | None:
        """Return a column of numbers, NaN where a cell is empty or marked bad."""
        if column is None:
            return None
        cells = [row.cells[column] for row in self._file.rows]
        name = self._file.header[column]
        found = self._parse(cells, column)
        if found.ambiguous is not None:
            self.report(
                name,
                f"{found.ambiguous!r} may be a decimal comma or grouped digits",
                "export it with a decimal point, or without groups of digits",
            )
        for index, count in list(found.wrong.items())[:_MAX_PROBLEMS]:
            more = f" (and {count - 1} more of this kind)" if count > 1 else ""
            self.report(
                name,
                f"{cells[index]!r} is not a number{more}",
                "correct it, or leave the cell empty where the sample is bad",
                self._file.rows[index].line,
            )
        if len(found.wrong) > _MAX_PROBLEMS:
            wrong = sum(list(found.wrong.values())[_MAX_PROBLEMS:])
            self.report(name, f"{wrong} more cells are wrong", "is it the right column?")
        elif not found.wrong and found.ambiguous is None:
            if found.values.size and np.isnan(found.values).all():
                words = ", ".join(map(repr, list(found.bad_words)[:_WORDS_SHOWN]))
                of_words = f", only {words} and the like" if words else ""
                self.report(name, f"holds no number at all{of_words}", "choose another column")
            if found.bad_words:
                words = ", ".join(
                    f"{word!r} in {count} rows" for word, count in found.bad_words.items()
                )
                self.notes.append(f"{name}: {words}: bad samples")
        return found.values

    def _parse(self, cells: Sequence[str], column: int) -> NumberCells:
        """Cells as numbers, in the notation of the other columns where they do not show theirs."""

        def proven() -> str | None:
            others = (n for n in range(len(self._file.header)) if n != column)
            marks = {self._file.decimal_mark(n) for n in others} - {None}
            return marks.pop() if len(marks) == 1 else None

        return parse_numbers(cells, comma_separates=self._file.separator == ",", proven=proven)

    def drop_bad_quality(self, numbers: Mapping[str, Floats | None], found: Columns) -> None:
        """Make the samples NaN that a column of quality calls bad.

        Args:
            numbers: values by role, changed in place.
            found: number of each role's column.
        """
        asked = {role: found.get(role) for role in numbers}
        for number, roles in quality_columns(self._file.header, asked).items():
            name = self._file.header[number]
            cells = [row.cells[number] for row in self._file.rows]
            # In an export of our own historian 0 is good, and every other code is not.
            own = is_own_export(self._file.header)
            good = np.array([cell == "0" for cell in cells]) if own else find_good(cells)
            if good is None:
                self.notes.append(f"{name} is left out: which of its values mean good is not known")
                continue
            dropped = 0
            for role in roles:
                values = numbers[role]
                if values is not None:
                    dropped = max(dropped, int(np.count_nonzero(~np.isnan(values) & ~good)))
                    values[~good] = np.nan
            if dropped:
                self.notes.append(f"{name}: {dropped} rows are not good: bad samples")

    def switch(self, column: int | None, *, is_guessed: bool = False) -> NDArray[np.bool_] | None:
        """Return a column of yes and no; an empty cell is no.

        A column that is only guessed to be one counts when it holds words: of a number alone it is
        not known which mode it means.
        """
        if column is None:
            return None
        if is_guessed and any(
            means_automatic(cell := row.cells[column]) is None and cell.lower() not in BAD
            for row in self._file.rows
        ):
            name = self._file.header[column]
            self.notes.append(f"{name} is left out: name it with --auto if 1 means automatic there")
            return None
        values = np.zeros(len(self._file.rows), dtype=np.bool_)
        wrong = 0
        for index, row in enumerate(self._file.rows):
            cell = row.cells[column].lower()
            state = means_automatic(cell)
            if cell in BAD or state is not None:
                values[index] = bool(state)
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

    def order(
        self, column: int | None, *, is_guessed: bool, gives_period: bool
    ) -> tuple[Rows, Sampling] | None:
        """Return the rows to use in the order of a time column, and what their times say.

        Args:
            column: its number.
            is_guessed: whether the column may be none of times.
            gives_period: whether nothing but the times tells the period. Only then, and where the
                column was not guessed, is it a problem that it holds no readable times; otherwise
                it gets a note, and nothing is returned.
        """
        if column is None:
            return None
        name = self._file.header[column]
        remedy = "correct it, or give the seconds between rows with --period"
        try:
            times = self.times(column)
            found = put_in_order(times, [row.cells for row in self._file.rows])
            sampling = sampling_of(found.times)
            if gives_period and not (times.is_unit_known or is_plausible(sampling.period)):
                raise NoClockError(
                    f"the times are {sampling.period:g} s apart if they count seconds; name their "
                    "unit in the heading, such as time [min]"
                )
        except NoClockError as error:
            line = None if error.index is None else self._file.rows[error.index].line
            if is_guessed or not gives_period:
                place = "" if line is None else f" in line {line}"
                self.notes.append(f"{name} is left out: {error}{place}; the rows stay as they are")
                return None
            self.report(name, str(error), remedy, line)
            return None
        if times.note is not None:
            self.notes.append(f"{name} {times.note}")
        self.notes.extend(found.notes)
        return found.rows, sampling

    def times(self, column: int) -> Times:
        """Return the moments of a column of times, in the order of the rows.

        Raises:
            NoClockError: naming the first row that fits no notation of time.
        """
        cells = [row.cells[column] for row in self._file.rows]
        dated, notes = join_dates(self._file, column, cells)
        self.notes.extend(notes)
        # Where the comma begins decimals, and a semicolon separates, the day is first.
        day_first = self._file.separator == ";"
        under = self._file.under_header
        below = [row.cells[column] for row in under if column < len(row.cells)]
        return parse_times(
            dated,
            lambda numbers: self._parse(numbers, column),
            unit=find_time_unit(self._file.header[column], below),
            day_first=day_first,
        )

    def _report_more(self, column: int, count: int) -> None:
        name = self._file.header[column]
        self.report(name, f"{count} more cells are wrong", "is it the right column?")


def _remedy_of(role: str, names: Sequence[str], choose: str) -> str:
    """What to do about several columns for a role: ``choose`` one if their headings differ."""
    if len(set(names)) == len(names):
        return choose
    if role == "time":
        return "they differ: export all signals at the same moments"
    return "they differ, so rename one of them in the header"
