"""Recorded loops: files with a row a sample.

    recording = read_recording(Path("FC101.csv"))
    recording.op, recording.pv, recording.period

Columns are found by name in any case, whatever their order and whatever else the file holds: by the
names of the roles, or by what people write for them (`column_names`). An empty cell, ``nan`` or a
historian's word for a bad value (`number_cells`) is a bad sample (NaN); any other text in a number
column is an error that names its row. Rows are put in the order of time (`row_order`).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fieldlink.file_at import is_pipe_or_device
from fieldlink.site.bad_numbers import drop_bad_numbers
from fieldlink.site.binary_tables import MIN_ROWS
from fieldlink.site.csv_file import CsvFile
from fieldlink.site.errors import Problem, RecordingError, nearest
from fieldlink.site.long_form import LoopTable
from fieldlink.site.recorded_columns import RecordedColumns
from fieldlink.site.recorded_loops import find_loops, refuse_several
from fieldlink.site.recorded_table import RecordedTable, read_recorded_table
from fieldlink.site.timestamps import Sampling

__all__ = [
    "HIDDEN",
    "MIN_ROWS",
    "PACKED",
    "PARQUET",
    "PERIODS_DIFFER",
    "NanRun",
    "Recording",
    "files_in",
    "open_recordings",
    "read_recording",
    "read_recordings",
]

PARQUET = (".parquet", ".parq", ".pq")
PACKED = (".xls", ".gz", ".zip", ".bz2", ".xz", ".zst", ".7z")
"""Reading these says what to do: none of a site's recordings is passed over without a word."""
ENDINGS = (".csv", ".tsv", ".xlsx", *PARQUET, ".mat", *PACKED)
"""Files of a folder that are recordings; a file that is named itself may end otherwise."""

HIDDEN = (".", "~$")
"""How names begin of what no person put there: copies of a file system's snapshots, which would
be read as recordings once more, attributes of files, locks of spreadsheets."""

PERIODS_DIFFER = 0.05
"""Share of a given period by which the times may differ and still agree with it: as much as an
interval may differ and count as regular (`timestamps`)."""

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
        start: of the first row of the file, seconds since 1970 (UTC), None without a date.
        irregular: intervals that differ from the period by more than a twentieth of it.
        nan_runs: runs of bad samples in OP, PV and SP.
        notes: what a reader should know about the file, in words.
    """

    path: Path
    op: Floats
    pv: Floats
    sp: Floats | None
    auto: NDArray[np.bool_] | None
    period: float
    time: Floats | None
    start: float | None
    irregular: int
    nan_runs: tuple[NanRun, ...]
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return int(self.op.size)

    def cut(self, rows: slice) -> Recording:
        """Return the rows of a slice; period and notes stay those of the whole file."""
        start, stop, step = rows.indices(len(self))
        if step != 1 or stop <= start:
            raise ValueError(f"{rows} is not a run of rows of a recording of {len(self)}")
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


def files_in(path: Path) -> list[Path]:
    """Return the recordings of a folder in the order of their names, or the file itself.

    A pipe or a device in a folder is none: reading it would wait for a writer without end.

    Raises:
        RecordingError: the folder cannot be listed.
    """
    if not os.path.isdir(path):
        return [path]
    try:
        named = [
            file
            for file in path.iterdir()
            if file.suffix.lower() in ENDINGS and not file.name.startswith(HIDDEN)
        ]
        return sorted(file for file in named if not is_pipe_or_device(file))
    except OSError as error:
        message = f"cannot be listed ({error.strerror})"
        raise RecordingError([Problem(str(path), "", message, "check its permissions")]) from error


def read_recording(
    path: str | Path,
    *,
    op: str | None = None,
    pv: str | None = None,
    sp: str | None = None,
    auto: str | None = None,
    time: str | None = None,
    period: float | None = None,
    loop: str | None = None,
    needs_pv: bool = True,
) -> Recording:
    """Read a recorded loop.

    Args:
        path: as for `recorded_table.read_recorded_table`.
        op, pv, sp, auto, time: names of the columns; by default those of these names or of names
            that mean the same (`column_names`), of which only OP and PV must be there.
        period: seconds between rows; it counts more than the period of a time column, whose times
            still order the rows. Without either a row is a second.
        loop: name of the loop in a file of several, in any case.
        needs_pv: whether a file without PV is refused; otherwise its PV is all NaN.

    Raises:
        RecordingError: naming the file, the row and the column, and what to do.
    """
    wanted = {"op": op, "pv": pv, "sp": sp, "auto": auto, "time": time}
    table = _table(path, wanted)
    # Without a name the loop side by side is meant whose headings are plainest, if there is one.
    loops = find_loops(table, wanted, needs_pv=needs_pv, beside=loop is not None)
    if loop is not None:
        return _read(loops[_named(table, list(loops), loop)], period, needs_pv=needs_pv)
    refuse_several(table, list(loops))
    (own,) = loops.values()
    return _read(own, period, needs_pv=needs_pv)


def open_recordings(
    path: str | Path,
    columns: Mapping[str, str | None],
    period: float | None = None,
    *,
    needs_pv: bool = True,
) -> dict[str, Callable[[], Recording]]:
    """Open a file that may hold several loops (`recorded_loops`).

    Args:
        path: as for `read_recording`.
        columns: names of the columns by role (op, pv, sp, auto, time), None for the role's own.
        period: seconds between rows of a loop.
        needs_pv: as for `read_recording`.

    Returns:
        By the loop's name, empty for the only loop of a file, what reads it. What is wrong with one
        is a `RecordingError` of its own then, and costs the others nothing.

    Raises:
        RecordingError: see `read_recording`.
    """
    wanted = {role: columns.get(role) for role in ("op", "pv", "sp", "auto", "time")}
    loops = find_loops(_table(path, wanted), wanted, needs_pv=needs_pv)
    return {name: partial(_read, own, period, needs_pv=needs_pv) for name, own in loops.items()}


def read_recordings(
    path: str | Path, columns: Mapping[str, str | None], period: float | None = None
) -> Iterator[tuple[str, Recording]]:
    """Read all loops of a file, see `open_recordings`.

    Yields:
        The loop's name, empty for the only loop of a file, and its recording.

    Raises:
        RecordingError: see `read_recording`; of several loops behind the last one.
    """
    yield from _each_or_problems(open_recordings(path, columns, period).items())


def _table(path: str | Path, wanted: Mapping[str, str | None]) -> RecordedTable:
    named = [name for name in wanted.values() if name is not None]
    return read_recorded_table(Path(path), named)


def _named(table: RecordedTable, loops: list[str], loop: str) -> str:
    """The loop of a name in any case.

    Raises:
        RecordingError: there is none.
    """
    folded = {name.casefold(): name for name in reversed(loops)}
    found = loop if loop in loops else folded.get(loop.strip().casefold())
    if found is None or not found:
        remedy = nearest(loop, [name for name in loops if name])
        if loops == [""]:
            remedy = "the file holds a single loop without a name: leave --loop out"
        place = str(table.file.path)
        raise RecordingError([Problem(place, loop, "no loop of that name", remedy)])
    return found


def _read(
    own: LoopTable | RecordingError, period: float | None, *, needs_pv: bool = True
) -> Recording:
    if isinstance(own, RecordingError):
        raise own
    return _recording_of(own.file, own.wanted, period, needs_pv=needs_pv, notes=own.notes)


def _each_or_problems(
    readings: Iterable[tuple[str, Callable[[], Recording]]],
) -> Iterator[tuple[str, Recording]]:
    """Yield what can be read, with its name; what is wrong with the others is told at the end.

    Raises:
        RecordingError: with the problems of all that cannot be read.
    """
    problems: list[Problem] = []
    for name, read in readings:
        try:
            recording = read()
        except RecordingError as error:
            problems.extend(error.problems)
        else:
            yield name, recording
    if problems:
        raise RecordingError(problems)


def _recording_of(
    file: CsvFile,
    wanted: Mapping[str, str | None],
    period: float | None,
    *,
    needs_pv: bool = True,
    notes: tuple[str, ...] = (),
) -> Recording:
    columns = RecordedColumns(file, ("op", "pv") if needs_pv else ("op",))
    found = columns.find_all(wanted)
    numbers = {role: columns.numbers(found[role]) for role in ("op", "pv", "sp")}
    switched = columns.switch(found["auto"], is_guessed=columns.is_guessed("auto"))
    if period is not None and not 0 < period < np.inf:
        columns.report("", f"a period of {period} s is impossible", "give seconds above 0")
    columns.drop_bad_quality(numbers, found)
    columns.notes.extend(drop_bad_numbers(numbers))
    sampling = None
    if not columns.problems and len(file.rows) < MIN_ROWS:
        columns.report(
            "", f"has {len(file.rows)} rows, at least {MIN_ROWS} are needed", "record for longer"
        )
    else:
        order = columns.order(
            found["time"], is_guessed=columns.is_guessed("time"), gives_period=period is None
        )
        if order is not None:
            rows, sampling = order
            numbers = {role: None if v is None else v[rows] for role, v in numbers.items()}
            switched = None if switched is None else switched[rows]
    op_values, pv_values = numbers["op"], numbers["pv"]
    if op_values is not None and pv_values is None and not needs_pv:
        pv_values = np.full(op_values.size, np.nan)
    if columns.problems or op_values is None or pv_values is None:
        raise RecordingError(columns.problems)
    nan_runs = _nan_runs(numbers)
    return Recording(
        path=file.path,
        op=op_values,
        pv=pv_values,
        sp=numbers["sp"],
        auto=switched,
        period=period if period is not None else 1.0 if sampling is None else sampling.period,
        time=None if sampling is None else sampling.seconds,
        start=None if sampling is None else sampling.start,
        irregular=0 if sampling is None else sampling.irregular,
        nan_runs=nan_runs,
        notes=(*notes, *columns.notes, *_notes(op_values, period, sampling, nan_runs)),
    )


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
    op: Floats, period: float | None, sampling: Sampling | None, nan_runs: tuple[NanRun, ...]
) -> tuple[str, ...]:
    notes = []
    if np.nanmin(op) >= 0.0 and np.nanmax(op) <= 1.0:
        notes.append(
            "op lies between 0 and 1: S and J in its units are shares of its range, 0.04 is 4 %"
        )
    if period is None and sampling is None:
        notes.append("no time column and no period given: a row is taken for a second")
    if (
        period is not None
        and sampling is not None
        and abs(sampling.period / period - 1) > PERIODS_DIFFER
    ):
        notes.append(
            f"the time column says {sampling.period:g} s between rows; "
            f"the given {period:g} s counts"
        )
    if sampling is not None and sampling.clock is not None:
        notes.append(
            f"the clock counts in steps of {sampling.clock:g} s: the samples are taken as "
            f"{sampling.period:.4g} s apart"
        )
    elif sampling is not None and sampling.irregular:
        notes.append(
            f"sampling is irregular: {sampling.irregular} of {sampling.seconds.size - 1} intervals "
            f"differ from {sampling.period:g} s by more than 5 %, the longest is "
            f"{sampling.longest:g} s, the shortest {sampling.shortest:g} s"
        )
    for column in dict.fromkeys(run.column for run in nan_runs):
        rows = [run.rows for run in nan_runs if run.column == column]
        notes.append(
            f"{column}: {_counted(sum(rows), 'bad sample')} in {_counted(len(rows), 'run')}, "
            f"at most {max(rows)} in a row"
        )
    return tuple(notes)


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
