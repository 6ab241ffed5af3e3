"""A historian's SQL table: a row a moment, or a row a value; see `sql_description`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import closing
from datetime import UTC, datetime, timezone
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Column, DateTime, MetaData, Numeric, Select, Table, func, select
from sqlalchemy.exc import NoSuchTableError, SQLAlchemyError

from fieldlink.assess.cutting import MIN_ROWS, cut_windows
from fieldlink.assess.errors import PlaceAwayError, ReadingError
from fieldlink.assess.job import Job, Piece
from fieldlink.assess.readers.base import Named, split_in_time
from fieldlink.assess.readers.sql_description import LOOP, SqlTable
from fieldlink.assess.readers.sql_loops import MomentLoop, ValueLoop
from fieldlink.site.errors import nearest
from fieldlink.site.number_cells import find_decimal_mark, parse_numbers, plain_number
from fieldlink.site.numbered_times import counts_a_second, is_moment
from fieldlink.site.recorded_columns import means_automatic
from fieldlink.store.database import cause_of, is_away, open_for_reading, shown

__all__ = ["SqlReader", "TableReader"]

Floats = NDArray[np.float64]

_FIRST_TEXTS = 1000
"""Rows that show how a table writes numbers: a quarter of an hour of a loop sampled each second."""

_UNITS = {"milliseconds": "ms", "microseconds": "us", "nanoseconds": "ns"}


class SqlReader:
    """A place that is a description; `Place.where` is the description as JSON."""

    def pieces(self, job: Job, place: int, after: str) -> Iterator[Piece]:
        """List the loops, long ones in parts."""
        del after
        where = job.places[place]
        with closing(TableReader(SqlTable.model_validate_json(where.where))) as table:
            table.check_columns()
            for loop in table.loops():
                piece = Piece(place, where.shown, loop=loop)
                try:
                    stretch = table.stretch_of(loop, job.columns.period)
                except PlaceAwayError:
                    raise
                except ReadingError:
                    # Reading it says what is wrong; the others go on.
                    yield piece
                    continue
                yield from split_in_time(
                    piece, job.cut, stretch.first, stretch.last, stretch.period
                )

    def windows(self, job: Job, piece: Piece) -> Iterator[Named]:
        """Read a loop, a window at a time."""
        description = SqlTable.model_validate_json(job.places[piece.place].where)
        with closing(TableReader(description)) as table:
            stretch = table.stretch_of(piece.loop, job.columns.period)
            if not stretch.has_good_rows():
                good = ", ".join(map(repr, description.good))
                raise ReadingError(
                    f"none of its rows has a good quality ({description.quality} is never {good}); "
                    "check sql.good"
                )
            for window in cut_windows(stretch, piece, job.cut):
                yield piece.loop, window


class TableReader:
    """One table over one connection; `close` it when done.

    Raises:
        ReadingError: the database, the table or one of its columns is not there.
        PlaceAwayError: the database server does not answer.
    """

    def __init__(self, description: SqlTable) -> None:
        self.description = description
        self._shown = shown(description.url)
        self._engine = open_for_reading(description.url)
        schema, _, name = description.table.rpartition(".")
        try:
            self._table = Table(name, MetaData(), schema=schema or None, autoload_with=self._engine)
        except NoSuchTableError as error:
            raise ReadingError(
                f"{self._shown} has no table {description.table!r}; check sql.table"
            ) from error
        except SQLAlchemyError as error:
            raise self._unreadable(error) from error
        self.time = self.column(description.time, "time")

    def close(self) -> None:
        """Give the connection back."""
        self._engine.dispose()

    def column(self, name: str, key: str) -> Column[Any]:
        """Return a column by its name in any case."""
        for column in self._table.columns:
            if column.name.lower() == name.lower():
                return column
        known = [column.name for column in self._table.columns]
        raise ReadingError(
            f"{self._shown}: table {self.description.table} has no column {name!r} (sql.{key}); "
            f"{nearest(name, known)}"
        )

    def check_columns(self) -> None:
        """Raise `ReadingError` unless the table has all columns of the description."""
        for key, name in self.description.columns().items():
            self.column(name, key)

    def loops(self) -> Iterator[str]:
        """Yield the loops' names; each costs one look at the index of their column.

        Raises:
            ReadingError: no tag is one of a PV.
        """
        about = self.description
        if about.tags is not None and about.tag is not None:
            before, after = (re.escape(part) for part in about.tags.pv.split(LOOP))
            pattern = re.compile(f"{before}(.+){after}", re.DOTALL)
            first, matches = "", 0
            for tag in self._distinct(self.column(about.tag, "tag")):
                first = first or tag
                if found := pattern.fullmatch(tag):
                    matches += 1
                    yield found[1]
            if first and not matches:
                raise ReadingError(
                    f"{self._shown}: no tag is named like {about.tags.pv} (the first is {first}); "
                    "correct sql.tags"
                )
        elif about.loop is None:
            yield about.name
        else:
            yield from self._distinct(self.column(about.loop, "loop"))

    def stretch_of(self, loop: str, period: float | None) -> MomentLoop | ValueLoop:
        """Return one loop, to be read by time."""
        kind = MomentLoop if self.description.tags is None else ValueLoop
        return kind(self, loop, period)

    def rows(self, query: Select[Any]) -> Sequence[Any]:
        """Run a query."""
        try:
            with self._engine.connect() as connection:
                return connection.execute(query).all()
        except SQLAlchemyError as error:
            raise self._unreadable(error) from error

    def between(self, query: Select[Any], since: float, until: float) -> Select[Any]:
        """The query for moments from ``since`` on and before ``until``, seconds since 1970."""
        if math.isfinite(since):
            query = query.where(self.time >= self._stored(since))
        if math.isfinite(until):
            query = query.where(self.time < self._stored(until))
        return query

    def moment(self, value: Any) -> float:
        """A stamp of the table as seconds since 1970 (UTC)."""
        try:
            if isinstance(value, str):
                value = datetime.fromisoformat(value)
            if isinstance(value, datetime):
                return (value if value.tzinfo else value.replace(tzinfo=UTC)).timestamp()
            seconds = float(value) / self.description.counts_a_second
        except (TypeError, ValueError) as error:
            raise ReadingError(
                f"{self._shown}: {str(value)!r} in column {self.time.name} is not a moment; store "
                "timestamps, ISO 8601 text or numbers"
            ) from error
        counted = None if is_moment(seconds) else counts_a_second(float(value))
        if counted is not None:
            raise ReadingError(
                f"{self._shown}: the numbers in column {self.time.name}, such as {value}, count "
                f'{counted[0]}; set sql.time_unit = "{_UNITS[counted[0]]}"'
            )
        return seconds

    def switch(self, values: Sequence[Any]) -> Floats:
        """Modes as 1 and 0: words such as ``AUTO``, or numbers; NaN for NULL."""
        states = [means_automatic(one.strip()) if isinstance(one, str) else None for one in values]
        return self.numbers(
            [one if state is None else state for one, state in zip(values, states, strict=True)]
        )

    def numbers(self, values: Sequence[Any]) -> Floats:
        """Values as numbers; NaN for NULL, and for a text such as ``Bad`` among numbers."""
        texts = [one for one in values if isinstance(one, str)]
        parsed = parse_numbers(
            [text.strip() for text in texts],
            comma_separates=False,
            proven=lambda: self._decimal_mark,
        )
        # A word among numbers is a bad value, a number written in another way than the others not.
        odd = next((texts[n] for n in parsed.wrong if _is_number(texts[n])), parsed.ambiguous)
        if odd is not None:
            raise ReadingError(
                f"{self._shown}: table {self.description.table} holds {odd!r}, which may be "
                "decimals or grouped digits; give a view with numbers"
            )
        of_texts = iter(parsed.values.tolist())
        found = np.array(
            [next(of_texts) if isinstance(one, str) else _number(one) for one in values],
            dtype=np.float64,
        )
        if len(texts) >= MIN_ROWS and np.isnan(found).all():
            raise ReadingError(
                f"{self._shown}: table {self.description.table} holds text where numbers belong "
                f"({texts[0]!r}); check the names of the columns"
            )
        return found

    @cached_property
    def _decimal_mark(self) -> str | None:
        """What begins decimals in numbers that are text, by the first values of the table."""
        names = self.description.columns()
        keys = [key for key in ("op", "pv", "sp", "value") if key in names]
        columns = [self.column(names[key], key) for key in keys]
        rows = self.rows(select(*columns).limit(_FIRST_TEXTS))
        found = {
            find_decimal_mark(value for value in values if isinstance(value, str))
            for values in zip(*rows, strict=True)
        }
        marks = found - {None}
        return marks.pop() if len(marks) == 1 else None

    def _stored(self, moment: float) -> Any:
        kind = self.time.type
        if isinstance(kind, DateTime):
            aware = datetime.fromtimestamp(moment, UTC)
            return aware if kind.timezone else aware.replace(tzinfo=None)
        if isinstance(kind, Numeric) or kind.python_type in (int, float):
            return moment * self.description.counts_a_second
        separator, offset = self._text_form
        text = datetime.fromtimestamp(moment, offset or UTC).replace(tzinfo=None).isoformat()
        return text.replace("T", separator)

    @cached_property
    def _text_form(self) -> tuple[str, timezone | None]:
        """How moments are written that are text: what separates the day, and their time zone."""
        row = self.rows(select(func.min(self.time), func.max(self.time)))[0]
        ends = [end for end in row if isinstance(end, str)]
        if not ends:
            return "T", None
        for end in ends:
            self.moment(end)
        offsets = [datetime.fromisoformat(end).utcoffset() for end in ends]
        if offsets[0] != offsets[-1]:
            raise ReadingError(
                f"{self._shown}: column {self.time.name} holds text of two time zones ({ends[0]} "
                f"and {ends[-1]}), and its order is not that of time; give a view with timestamps, "
                "or with the text in UTC"
            )
        return "T" if "T" in ends[0] else " ", None if offsets[0] is None else timezone(offsets[0])

    def _distinct(self, column: Column[Any]) -> Iterator[str]:
        query = select(func.min(column))
        found = self.rows(query)[0][0]
        while found is not None:
            yield str(found)
            found = self.rows(query.where(column > found))[0][0]

    def _unreadable(self, error: SQLAlchemyError) -> ReadingError:
        kind = PlaceAwayError if is_away(self._engine, error) else ReadingError
        return kind(
            f"{self._shown} cannot be read: {cause_of(error)}; check the address and the rights"
        )


def _is_number(text: str) -> bool:
    try:
        plain_number(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _number(value: Any) -> float:
    try:
        return math.nan if value is None else float(value)
    except (TypeError, ValueError):
        return math.nan
