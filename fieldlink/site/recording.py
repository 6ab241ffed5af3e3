"""Recorded loops: CSV files with a row a sample.

    recording = read_recording(Path("FC101.csv"))
    recording.op, recording.pv, recording.period

Columns are found by name in any case, whatever their order and whatever else the file holds. An
empty cell, ``nan`` or ``null`` is a bad sample (NaN); any other text in a number column is an error
that names its row.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.csv_file import CsvFile, read_csv
from fieldlink.site.errors import Problem, RecordingError, nearest
from fieldlink.site.timestamps import NoClockError, Sampling, parse_times, sampling_of

__all__ = ["MIN_ROWS", "NanRun", "Recording", "read_recording"]

MIN_ROWS = 50
"""Fewer rows hold too little of an oscillation to judge."""

_BAD = frozenset({"", "nan", "null", "na", "n/a", "#n/a", "none"})
_TRUE = frozenset({"true", "yes", "on", "auto", "automatic", "cas", "cascade"})
_FALSE = frozenset({"false", "no", "off", "man", "manual"})
_MAX_PROBLEMS = 10

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class NanRun:
    """A run of bad samples: ``rows`` of them from index ``start`` on (0-based sample)."""

    column: str
    start: int
    rows: int


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One recorded loop; arrays have the shape ``(rows,)``, NaN marks a bad sample.

    Attributes:
        path: the file.
        op, pv: controller output and process variable.
        sp: set-point, None without such a column.
        auto: whether the loop was in automatic, None without such a column.
        period: seconds between samples.
        time: seconds since the first sample as recorded, None without a usable time column.
        irregular: intervals that differ from the period by more than a twentieth of it.
        nan_runs: runs of bad samples in OP, PV and SP.
        notes: what a reader should know about the file, in words.
        start: the first sample's time in the seconds of the time column, None without one.
    """

    path: Path
    op: Floats
    pv: Floats
    sp: Floats | None
    auto: NDArray[np.bool_] | None
    period: float
    time: Floats | None
    irregular: int
    nan_runs: tuple[NanRun, ...]
    notes: tuple[str, ...]
    start: float | None = None

    def __len__(self) -> int:
        return int(self.op.size)

    def cut(self, rows: slice) -> Recording:
        """Return the rows of a slice; period and notes stay those of the whole file."""
        start, stop, step = rows.indices(len(self))
        if step != 1 or stop <= start:
            raise ValueError(f"{rows} is no run of rows of a recording of {len(self)}")
        op, pv = self.op[rows], self.pv[rows]
        sp = None if self.sp is None else self.sp[rows]
        return replace(
            self,
            op=op,
            pv=pv,
            sp=sp,
            auto=None if self.auto is None else self.auto[rows],
            time=None if self.time is None else self.time[rows],
            nan_runs=_nan_runs({"op": op, "pv": pv, "sp": sp}),
        )


def read_recording(
    path: str | Path,
    *,
    op: str | None = None,
    pv: str | None = None,
    sp: str | None = None,
    auto: str | None = None,
    time: str | None = None,
    period: float | None = None,
    needs_pv: bool = True,
) -> Recording:
    """Read a recorded loop.

    Args:
        path: CSV file with a header; comma, semicolon or tab between cells.
        op, pv, sp, auto, time: names of the columns; by default those of these names, of which only
            OP and PV must be there.
        needs_pv: whether a file without PV is refused; otherwise its PV is all NaN.
        period: seconds between rows; it counts more than a time column. Without either a row is a
            second.

    Raises:
        RecordingError: naming the file, the row and the column, and what to do.
    """
    file = read_csv(Path(path), RecordingError, pipe=True)
    columns = _Columns(file, {"op", "pv"} if needs_pv else {"op"})
    wanted = {"op": op, "pv": pv, "sp": sp, "auto": auto, "time": time}
    found = {role: columns.find(role, name) for role, name in wanted.items()}
    numbers = {role: columns.numbers(found[role]) for role in ("op", "pv", "sp")}
    switched = columns.switch(found["auto"])
    if period is not None and not 0 < period < np.inf:
        columns.report("", f"a period of {period} s is impossible", "give seconds above 0")
    sampling = None
    if time is not None or period is None:
        sampling = columns.sampling(found["time"])
    if not columns.problems and len(file.rows) < MIN_ROWS:
        columns.report(
            "", f"has {len(file.rows)} rows, at least {MIN_ROWS} are needed", "record for longer"
        )
    op_values, pv_values = numbers["op"], numbers["pv"]
    if op_values is not None and pv_values is None and not needs_pv:
        pv_values = np.full(op_values.size, np.nan)
    if columns.problems or op_values is None or pv_values is None:
        raise RecordingError(columns.problems)
    nan_runs = _nan_runs(numbers)
    return Recording(
        path=Path(path),
        op=op_values,
        pv=pv_values,
        sp=numbers["sp"],
        auto=switched,
        period=period if period is not None else 1.0 if sampling is None else sampling.period,
        time=None if sampling is None else sampling.seconds,
        irregular=0 if sampling is None else sampling.irregular,
        nan_runs=nan_runs,
        notes=_notes(period, sampling, nan_runs),
        start=None if sampling is None else sampling.start,
    )


class _Columns:
    """Finds and converts the columns of a file, and collects what is wrong."""

    def __init__(self, file: CsvFile, needed: set[str]) -> None:
        self._file = file
        self._needed = needed
        self.problems: list[Problem] = []

    def report(self, column: str, message: str, remedy: str, line: int | None = None) -> None:
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


def _nan_runs(numbers: Mapping[str, Floats | None]) -> tuple[NanRun, ...]:
    runs: list[NanRun] = []
    for column, values in numbers.items():
        if values is None:
            continue
        bad = np.concatenate([[False], np.isnan(values), [False]])
        edges = np.flatnonzero(bad[1:] != bad[:-1])
        runs.extend(
            NanRun(column, int(start), int(stop - start))
            for start, stop in zip(edges[::2], edges[1::2], strict=True)
        )
    return tuple(runs)


def _notes(
    period: float | None, sampling: Sampling | None, nan_runs: tuple[NanRun, ...]
) -> tuple[str, ...]:
    notes = []
    if period is None and sampling is None:
        notes.append("no time column and no period given: a row is taken for a second")
    if period is not None and sampling is not None and abs(sampling.period / period - 1) > 0.05:
        notes.append(
            f"the time column says {sampling.period:g} s between rows; "
            f"the given {period:g} s counts"
        )
    if sampling is not None and sampling.irregular:
        notes.append(
            f"sampling is irregular: {sampling.irregular} of {sampling.seconds.size - 1} intervals "
            f"differ from {sampling.period:g} s by more than 5 %, the longest is "
            f"{sampling.longest:g} s, the shortest {sampling.shortest:g} s"
        )
    for column in dict.fromkeys(run.column for run in nan_runs):
        rows = [run.rows for run in nan_runs if run.column == column]
        notes.append(
            f"{column}: {sum(rows)} bad samples in {len(rows)} runs, at most {max(rows)} in a row"
        )
    return tuple(notes)
