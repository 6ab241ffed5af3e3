"""Recordings with a row for each value: time, tag, value and mostly quality.

    tables_by_loop(file, find_long_columns(file.header), {})    # by loop: a row a moment

So export historians and the archives of panels. A loop's rows are the moments of its PV. OP stands
at the same moments or less than half a period from them; set-point and mode, which are stored when
they change, hold until their next value. Nothing is drawn between values of OP or PV.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.column_names import guess_columns, loops_side_by_side, note_of_left_out
from fieldlink.site.csv_file import CsvFile, CsvRow
from fieldlink.site.errors import Problem, RecordingError, nearest
from fieldlink.site.long_columns import LongColumns
from fieldlink.site.number_cells import find_decimal_mark, parse_numbers
from fieldlink.site.quality_codes import find_good
from fieldlink.site.recorded_columns import RecordedColumns
from fieldlink.site.times import NoClockError
from fieldlink.spreadsheet import from_cell

__all__ = ["LoopTable", "tables_by_loop"]

_PAIRED = 0.5
"""Share of PV's moments that need a value of OP: below it OP is stored at another rate, or when it
changes, and most samples would be bad."""
_BAD = "Bad"
"""Takes the place of a value whose quality is not good, see `number_cells.is_bad_value`."""

Floats = NDArray[np.float64]
Wanted = Mapping[str, str | None]


@dataclass(frozen=True, slots=True)
class LoopTable:
    """A loop as a table with a row for each moment.

    Attributes:
        file: the table; its columns are named by the loop's tags.
        wanted: names of the columns by role, as for `RecordedColumns.find_all`.
        notes: how it came about, in words.
    """

    file: CsvFile
    wanted: Wanted
    notes: tuple[str, ...]


def tables_by_loop(
    file: CsvFile, columns: LongColumns, wanted: Wanted, *, needs_pv: bool = True
) -> dict[str, LoopTable | RecordingError]:
    """Return the loops of a table with a row for each value; an error in place of a bad one.

    Args:
        file: the table.
        columns: of the table.
        wanted: tags by role, None for one that is to be found by its name.
        needs_pv: whether a loop without PV is refused; otherwise its rows are OP's moments.

    Raises:
        RecordingError: no tag is OP or PV, several may be, or the times cannot be read.
    """
    values = _Values(file, columns)
    if wanted.get("op") is None and wanted.get("pv") is None:
        beside = loops_side_by_side(values.tags, alone=True)
        if beside:
            values.notes.extend(note_of_left_out(values.tags))
            return {
                name: _table_or_error(values, {**wanted, **tags}) for name, tags in beside.items()
            }
    return {"": _table_of(values, wanted, needs_pv=needs_pv)}


def _table_or_error(values: _Values, wanted: Wanted) -> LoopTable | RecordingError:
    try:
        return _table_of(values, wanted)
    except RecordingError as error:
        return error


class _Values:
    """The rows of every tag in the order of the file, and their moments."""

    def __init__(self, file: CsvFile, columns: LongColumns) -> None:
        self.file = file
        self.columns = columns
        self.notes: list[str] = []
        self._rows: dict[str, list[int]] = {}
        for index, row in enumerate(file.rows):
            if tag := from_cell(row.cells[columns.tag]):
                self._rows.setdefault(tag, []).append(index)
        self.tags = list(self._rows)
        self._cells = self._read_cells()
        self._seconds: Floats | None = None

    def rows(self, tag: str) -> NDArray[np.int64]:
        """Numbers of a tag's rows."""
        return np.array(self._rows[tag], dtype=np.int64)

    def cell(self, row: int) -> str:
        """The value in a row."""
        return self._cells[row]

    def moment(self, row: int) -> tuple[str, ...]:
        """Date and time of a row as they stand."""
        cells = self.file.rows[row].cells
        return tuple(cells[number] for number in (self.columns.time, *self.columns.dates))

    def seconds(self) -> Floats:
        """The moment of every row.

        Raises:
            RecordingError: the times cannot be read.
        """
        if self._seconds is None:
            number = self.columns.time
            try:
                self._seconds = RecordedColumns(self.file).times(number).seconds
            except NoClockError as error:
                line = None if error.index is None else self.file.rows[error.index].line
                raise self.refusal(
                    self.file.header[number], str(error), "correct it", line
                ) from error
        return self._seconds

    def find(self, wanted: Wanted, *, needs_pv: bool) -> dict[str, str | None]:
        """Return the tags of a loop by role, None for one without a tag."""
        named = {role: self._named(role, name) for role, name in wanted.items() if name is not None}
        named.pop("time", None)
        numbers = {role: self.tags.index(tag) for role, tag in named.items()}
        guess = guess_columns(self.tags, numbers)
        found = {role: named.get(role) for role in ("op", "pv", "sp", "auto")}
        for role, number in guess.columns.items():
            if role in found:
                found[role] = self.tags[number]
        for role in ("op", "pv") if needs_pv else ("op",):
            several = guess.ambiguous.get(role)
            if found[role] is None and several:
                more = ", ..." if len(several) > 5 else ""
                message = f"several tags may be meant: {', '.join(several[:5])}{more}"
                raise self.refusal(role, message, f"choose one with --{role} {several[0]!r}")
            if found[role] is None:
                remedy = f"{nearest(role, self.tags)}, or say which tag is {role}"
                raise self.refusal(role, "no tag of that name", remedy)
        return found

    def refusal(
        self, column: str, message: str, remedy: str, line: int | None = None
    ) -> RecordingError:
        """Return the error of the file."""
        return RecordingError([Problem(str(self.file.path), column, message, remedy, line)])

    def check(self, tag: str) -> None:
        """Refuse a tag whose values are no numbers.

        Raises:
            RecordingError: naming the rows.
        """
        rows = self.rows(tag)
        found = parse_numbers(
            [self._cells[row] for row in rows],
            comma_separates=self.file.separator == ",",
            proven=lambda: find_decimal_mark(self._cells),
        )
        if found.wrong:
            index = next(iter(found.wrong))
            count = sum(found.wrong.values()) - 1
            more = f" (and {count} more)" if count else ""
            raise self.refusal(
                tag,
                f"{self._cells[rows[index]]!r} is not a number{more}",
                "correct it, or leave the cell empty where the sample is bad",
                self.file.rows[rows[index]].line,
            )

    def _named(self, role: str, name: str) -> str:
        if role == "time":
            return name
        folded = {tag.casefold(): tag for tag in reversed(self.tags)}
        found = name if name in self._rows else folded.get(name.strip().casefold())
        if found is None:
            raise self.refusal(name, "no tag of that name", nearest(name, self.tags))
        return found

    def _read_cells(self) -> list[str]:
        """The values, those of a bad quality as words for bad ones."""
        value, quality = self.columns.value, self.columns.quality
        cells = [row.cells[value] for row in self.file.rows]
        if quality is None:
            return cells
        heading = self.file.header[quality]
        judged = [row.cells[quality] for row in self.file.rows]
        # Panels of WinCC: 1 is a valid value, 0 and 2 are not.
        is_flag = heading.casefold() == "validity"
        good = np.array([cell == "1" for cell in judged]) if is_flag else find_good(judged)
        if good is None:
            self.notes.append(f"{heading} is left out: which of its values mean good is not known")
            return cells
        return [cell if is_good else _BAD for cell, is_good in zip(cells, good, strict=True)]


def _table_of(values: _Values, wanted: Wanted, *, needs_pv: bool = True) -> LoopTable:
    file, columns = values.file, values.columns
    found = values.find(wanted, needs_pv=needs_pv)
    tags = {role: tag for role, tag in found.items() if tag is not None}
    first = "pv" if "pv" in tags else "op"
    for role in tags:
        if role != "auto":
            values.check(tags[role])
    rows = values.rows(tags[first])
    signals = {first: [values.cell(row) for row in rows]}
    for role, tag in tags.items():
        if role in ("sp", "auto"):
            signals[role] = _held(values, rows, values.rows(tag))
        elif role != first:
            signals[role] = _paired(values, rows, tags[first], tag)
    order = [role for role in tags if role in signals]
    moments = [values.moment(row) for row in rows]
    cells = zip(*(signals[role] for role in order), strict=True)
    dates = [file.header[number] for number in columns.dates]
    table = replace(
        file,
        header=(file.header[columns.time], *dates, *(tags[role] for role in order)),
        rows=tuple(
            CsvRow(file.rows[row].line, (*moment, *own))
            for row, moment, own in zip(rows, moments, cells, strict=True)
        ),
        under_header=tuple(
            CsvRow(row.line, (row.cells[columns.time],)) for row in file.under_header
        ),
    )
    named = ", ".join(f"{role} is {tags[role]!r}" for role in order)
    note = f"a row for each value of {len(values.tags)} tags: {named}"
    # What a number means as a mode is known only where the tag was named.
    own = {
        role: found[role] if role in ("op", "pv") or wanted.get(role) else None for role in found
    }
    return LoopTable(table, {**own, "time": table.header[0]}, (note, *values.notes))


def _paired(values: _Values, rows: NDArray[np.int64], first: str, tag: str) -> list[str]:
    """The values of a tag in the rows of another: at the same moments, or at the nearest.

    Raises:
        RecordingError: most moments have none.
    """
    own = values.rows(tag)
    known: dict[tuple[str, ...], list[int]] = {}
    for row in own:
        known.setdefault(values.moment(row), []).append(row)
    # A moment may stand twice: after a seam, or in the hour that a clock set back repeats.
    met: Counter[tuple[str, ...]] = Counter()
    cells = []
    for row in rows:
        moment = values.moment(row)
        at = known.get(moment, [])
        cells.append(values.cell(at[min(met[moment], len(at) - 1)]) if at else "")
        met[moment] += 1
    if sum(map(bool, cells)) < _PAIRED * len(cells):
        cells = _nearest(values, rows, own)
    count = sum(map(bool, cells))
    if count < _PAIRED * len(cells):
        raise values.refusal(
            tag,
            f"{len(own)} values, of which {count} belong to the {len(cells)} moments of {first}: "
            "it is stored at another rate, or when it changes",
            "export both at one fixed rate, as they were measured",
        )
    return cells


def _nearest(values: _Values, rows: NDArray[np.int64], own: NDArray[np.int64]) -> list[str]:
    seconds = values.seconds()
    stamps = np.sort(seconds[rows][~np.isnan(seconds[rows])])
    own = own[~np.isnan(seconds[own])]
    if stamps.size < 2 or own.size == 0:
        return [""] * len(rows)
    own = own[np.argsort(seconds[own], kind="stable")]
    steps = np.diff(stamps)
    within = 0.5 * float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    at = seconds[own]
    after = np.clip(np.searchsorted(at, seconds[rows]), 1, max(1, at.size - 1))
    before = after - 1
    after = np.minimum(after, at.size - 1)
    late, early = np.abs(at[after] - seconds[rows]), np.abs(seconds[rows] - at[before])
    chosen = np.where(late < early, after, before)
    is_near = np.minimum(late, early) < within
    return [values.cell(own[n]) if near else "" for n, near in zip(chosen, is_near, strict=True)]


def _held(values: _Values, rows: NDArray[np.int64], own: NDArray[np.int64]) -> list[str]:
    """The values of a tag that hold until the next one."""
    seconds = values.seconds()
    own = own[~np.isnan(seconds[own])]
    own = own[np.argsort(seconds[own], kind="stable")]
    place = np.searchsorted(seconds[own], seconds[rows], side="right") - 1
    return [values.cell(own[n]) if n >= 0 else "" for n in place]
