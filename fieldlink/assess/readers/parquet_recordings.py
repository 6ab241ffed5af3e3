"""Parquet files: one loop, a column ``loop``, or loops side by side.

``fieldlink export`` and data lakes write them. The file's own statistics and filters do the work: a
part of a loop is read without the rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldlink.assess.cutting import MIN_ROWS, cut_windows
from fieldlink.assess.errors import ReadingError
from fieldlink.assess.histories import named_by_file
from fieldlink.assess.job import Job, Piece
from fieldlink.assess.readers.base import Named, split_in_time
from fieldlink.assess.readers.parquet_values import good_rows, numbers_in, seconds_in, switch_in
from fieldlink.assess.series import Recorded, Series
from fieldlink.site.bad_numbers import drop_bad_numbers
from fieldlink.site.column_names import (
    PANDAS_INDEX,
    guess_columns,
    loops_side_by_side,
    note_of_left_out,
    quality_columns,
)
from fieldlink.site.errors import nearest
from fieldlink.site.numbered_times import (
    TIME_UNITS,
    counts_a_second,
    find_time_unit,
    is_moment,
    is_plausible,
)
from fieldlink.site.recording import PERIODS_DIFFER
from fieldlink.site.timestamps import typical_interval

__all__ = ["parquet_pieces", "parquet_windows"]

Floats = NDArray[np.float64]

FIRST_TIMES = 1000
"""Rows that are read at once to find a time: few, since nearly every file has one in the first."""


@dataclass(frozen=True, slots=True)
class _Columns:
    """Names of a file's columns by role, None where there is none."""

    op: str
    pv: str
    sp: str | None
    auto: str | None
    time: str | None
    loop: str | None
    guesses_auto: bool

    def qualities(self, header: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """The columns of quality with the roles whose values they judge."""
        names = {"op": self.op, "pv": self.pv, "sp": self.sp}
        numbers = {
            role: None if name is None else header.index(name) for role, name in names.items()
        }
        taken = {self.loop, self.time, self.auto}
        judged = quality_columns(header, numbers)
        return {header[n]: roles for n, roles in judged.items() if header[n] not in taken}


def parquet_pieces(job: Job, piece: Piece) -> Iterator[Piece]:
    """List the loops of a file; long ones in parts.

    The columns of loops and times are read once, a batch of rows at a time.
    """
    file = _open(piece.path)
    beside = list(_loops_beside(file.schema_arrow, job))
    columns = _find_columns(file.schema_arrow, piece.path, job, beside[0] if beside else "")
    if columns.time is None and columns.loop is None:
        yield from (replace(piece, loop=name) for name in beside or [piece.loop])
        return
    unit = _counts_a_second(file, columns)
    spans: dict[str, _Span] = {}
    read = [name for name in (columns.loop, columns.time) if name is not None]
    with _explained():
        for batch in file.iter_batches(columns=read):
            _measure(batch, columns, spans, unit)
    for name, span in _by_loop(spans, beside):
        own = replace(piece, loop=name) if columns.loop is not None or beside else piece
        if columns.time is None or not is_moment(span.first):
            yield own
        else:
            if columns.loop is None:
                own = replace(own, loop=own.loop or named_by_file(Path(piece.path), span.first))
            period = job.columns.period or max((span.last - span.first) / max(1, span.rows - 1), 0)
            yield from split_in_time(own, job.cut, span.first, span.last, period)


def parquet_windows(job: Job, piece: Piece) -> Iterator[Named]:
    """Read a piece's rows and cut them into windows."""
    import pyarrow.dataset as ds

    file = _open(piece.path)
    schema = file.schema_arrow
    columns = _find_columns(schema, piece.path, job, piece.loop or "")
    unit = _counts_a_second(file, columns)
    chosen = None
    if columns.loop is not None:
        field = ds.field(columns.loop)
        chosen = _as_names(field, schema.field(columns.loop).type) == piece.loop
        if not piece.loop:
            # Rows without a name are one loop, as in a text file.
            chosen |= field.is_null()
    for moment, is_first in ((piece.since, True), (piece.until, False)):
        if moment is not None and columns.time is not None:
            bound = _as_stored(moment, schema.field(columns.time).type, unit)
            field = ds.field(columns.time)
            side = field >= bound if is_first else field < bound
            chosen = side if chosen is None else chosen & side
    names = [columns.op, columns.pv, columns.sp, columns.auto, columns.time]
    names += columns.qualities(schema.names)
    with _explained():
        table = ds.dataset(piece.path, format="parquet").to_table(
            columns=[name for name in names if name is not None], filter=chosen
        )
    if table.num_rows < MIN_ROWS:
        if piece.since is None and piece.until is None:
            raise ReadingError(f"has {table.num_rows} rows, at least {MIN_ROWS} are needed")
        return
    series = _series(table, columns, schema.names, job.columns.period, unit)
    if piece.loop in _loops_beside(schema, job):
        series = replace(series, notes=(*note_of_left_out(schema.names), *series.notes))
    for window in cut_windows(Recorded(series), piece, job.cut):
        start = float(series.time[0]) if series.dated else None
        yield piece.loop or named_by_file(Path(piece.path), start), window


@dataclass(slots=True)
class _Span:
    first: float
    last: float
    rows: int


def _open(path: str) -> Any:
    try:
        import pyarrow.parquet as pq
    except ImportError as error:
        raise ReadingError("Parquet files need pyarrow; pip install 'fieldlink[assess]'") from error
    with _explained():
        return pq.ParquetFile(path)


@contextmanager
def _explained() -> Iterator[None]:
    import pyarrow as pa

    try:
        yield
    except MemoryError:
        # Arrow's own is an ArrowException as well.
        raise
    except (OSError, pa.ArrowException) as error:
        said = " ".join(str(error).split())
        raise ReadingError(f"cannot be read as Parquet ({said}); export it again") from error


def _loops_beside(schema: Any, job: Job) -> dict[str, dict[str, str]]:
    """Columns of op and pv of each loop, where a file has several side by side."""
    names = job.columns.names()
    has_own = any(name.lower() == "loop" for name in schema.names)
    if has_own or names["op"] is not None or names["pv"] is not None:
        return {}
    return loops_side_by_side(schema.names)


def _by_loop(spans: dict[str, _Span], beside: Sequence[str]) -> Iterator[tuple[str, _Span]]:
    """Spans by loop; loops side by side share the only one."""
    if beside:
        return ((name, span) for name in beside for span in spans.values())
    return iter(spans.items())


def _find_columns(schema: Any, path: str, job: Job, loop: str) -> _Columns:
    names = list(schema.names)
    folded = {name.lower(): name for name in reversed(names)}
    wanted: dict[str, str | None] = job.columns.names() | {"loop": None}
    wanted |= _loops_beside(schema, job).get(loop, {})

    def find(role: str) -> str | None:
        named = wanted[role]
        if named is None:
            return folded.get(role)
        found = named if named in names else folded.get(named.strip().lower())
        if found is None:
            raise ReadingError(f"has no column {named!r}; {nearest(named, names)}")
        return found

    found = {role: find(role) for role in wanted}
    known = {role: names.index(name) for role, name in found.items() if name is not None}
    named = {role: number for role, number in known.items() if role != "loop"}
    guess = guess_columns(names, named)
    found |= {role: names[number] for role, number in guess.columns.items() if not found[role]}
    if found["time"] is None and PANDAS_INDEX in names:
        import pyarrow as pa

        if pa.types.is_timestamp(schema.field(PANDAS_INDEX).type):
            found["time"] = PANDAS_INDEX
    for role in ("op", "pv"):
        if found[role] is None and role in guess.ambiguous:
            several = ", ".join(guess.ambiguous[role])
            raise ReadingError(
                f"{Path(path).name}: several columns may be {role}: {several}; "
                f"choose one with --{role} {guess.ambiguous[role][0]!r}"
            )
        if found[role] is None:
            remedy = f"{nearest(role, names)}; call it {role}, or choose it with --{role}"
            raise ReadingError(f"{Path(path).name} has no column {role}; {remedy}")
    guesses_auto = "auto" in guess.unsure and wanted["auto"] is None
    return _Columns(**found, guesses_auto=guesses_auto)  # type: ignore[arg-type]


def _counts_a_second(file: Any, columns: _Columns) -> float:
    """How many of what a column of numbers counts a second has, by the first and the heading."""
    if columns.time is None:
        return 1.0
    named = find_time_unit(columns.time, ())
    of_heading = 1.0 if named is None else 1.0 / TIME_UNITS[named]
    with _explained():
        for batch in file.iter_batches(columns=[columns.time], batch_size=FIRST_TIMES):
            times = seconds_in(batch.column(columns.time), 1.0)
            known = times[np.isfinite(times)]
            if known.size:
                first = float(known[0])
                counted = None if is_moment(first / of_heading) else counts_a_second(first)
                return of_heading if counted is None else counted[1]
    return of_heading


def _as_names(column: Any, kind: Any) -> Any:
    """A column of loops, or the field of one, as text: loops may have numbers."""
    import pyarrow as pa

    is_text = pa.types.is_string(kind) or pa.types.is_large_string(kind)
    return column if is_text or pa.types.is_dictionary(kind) else column.cast(pa.string())


def _as_stored(moment: float, kind: Any, unit: float) -> Any:
    import pyarrow as pa

    if not pa.types.is_timestamp(kind):
        return moment * unit
    return pa.scalar(round(moment * 1e6), pa.timestamp("us", kind.tz)).cast(kind)


def _measure(batch: Any, columns: _Columns, spans: dict[str, _Span], unit: float) -> None:
    """Take the rows of a batch into the spans of their loops."""
    import pyarrow.compute as pc

    times = np.zeros(batch.num_rows)
    if columns.time is not None:
        times = seconds_in(batch.column(columns.time), unit)
    names = np.zeros(batch.num_rows, dtype=np.int64)
    loops = [""]
    if columns.loop is not None:
        column = batch.column(columns.loop)
        coded = pc.dictionary_encode(_as_names(column, column.type))
        loops = [str(name) for name in coded.dictionary.to_pylist()]
        nameless = loops.index("") if "" in loops else len(loops)
        loops += [""] * (nameless == len(loops))
        names = np.asarray(coded.indices.fill_null(nameless))
    for code, loop in enumerate(loops):
        own = times[(names == code) & np.isfinite(times)]
        if own.size == 0:
            continue
        first, last = float(own.min()), float(own.max())
        span = spans.setdefault(loop, _Span(math.inf, -math.inf, 0))
        span.first, span.last = min(span.first, first), max(span.last, last)
        span.rows += int(own.size)


def _series(
    table: Any, columns: _Columns, header: Sequence[str], period: float | None, unit: float
) -> Series:
    values = _Signals(table, columns, header)
    op, pv, sp, auto = values.op, values.pv, values.sp, values.auto
    if columns.time is None:
        time = np.arange(op.size, dtype=np.float64) * (period or 1.0)
    else:
        time = seconds_in(table.column(columns.time).combine_chunks(), unit)
    known = np.flatnonzero(np.isfinite(time))
    order = known[np.argsort(time[known], kind="stable")]
    # Files that overlap hold a moment twice: the last one counts.
    order = order[np.append(np.diff(time[order]) > 0.0, np.ones(min(1, order.size), dtype=bool))]
    time = time[order]
    own = typical_interval(time, np.arange(time.size)) if time.size > 1 else 0.0
    step = period or own
    if not step > 0.0:
        raise ReadingError("its times do not increase; check the time column, or give --period")
    dated = columns.time is not None and is_moment(float(time[0]))
    if period is None and columns.time is not None and not dated and not is_plausible(step):
        raise ReadingError(
            f"its times are {step:g} s apart if they count seconds; name their unit in the column, "
            "such as time_min, or give --period"
        )
    if not dated and abs(own / step - 1.0) > PERIODS_DIFFER:
        # The given period counts, and a row is one.
        time = step * np.arange(time.size, dtype=np.float64)
    return Series(
        time=time if dated else time - time[0],
        op=op[order],
        pv=pv[order],
        sp=None if sp is None or np.isnan(sp).all() else sp[order],
        auto=None if auto is None or np.isnan(auto).all() else auto[order],
        period=step,
        dated=dated,
        notes=tuple(values.notes),
    )


class _Signals:
    """The signals of a table, NaN where a column of quality calls them bad; and notes on them."""

    def __init__(self, table: Any, columns: _Columns, header: Sequence[str]) -> None:
        self.notes: list[str] = []
        self.op = numbers_in(table.column(columns.op), columns.op)
        self.pv = numbers_in(table.column(columns.pv), columns.pv)
        self.sp = None if columns.sp is None else numbers_in(table.column(columns.sp), columns.sp)
        self.auto = None
        if columns.auto is not None:
            self.auto, note = switch_in(
                table.column(columns.auto), columns.auto, is_guessed=columns.guesses_auto
            )
            self.notes.extend([note] if note else [])
        for name, roles in columns.qualities(header).items():
            self._drop_bad(name, roles, good_rows(table.column(name), header))
        self.notes.extend(drop_bad_numbers({"op": self.op, "pv": self.pv, "sp": self.sp}))

    def _drop_bad(self, name: str, roles: Sequence[str], good: NDArray[np.bool_] | None) -> None:
        if good is None:
            self.notes.append(f"{name} is left out: which of its values mean good is not known")
            return
        signals = {"op": self.op, "pv": self.pv, "sp": self.sp}
        judged = [values for role in roles if (values := signals.get(role)) is not None]
        dropped = max(np.count_nonzero(~np.isnan(values) & ~good) for values in judged)
        for values in judged:
            values[~good] = np.nan
        if dropped:
            self.notes.append(f"{name}: {dropped} rows are not good: bad samples")
