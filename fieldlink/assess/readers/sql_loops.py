"""One loop of a historian's SQL table as samples: from a row a moment, or from a row a value.

Values of OP and PV go where their stamps say and nothing is drawn between them: a straight line of
the historian's would hide what a sticky valve does. Set-point and mode, which historians store when
they change, hold until the next value.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Column, Select, func, select

from fieldlink.assess.errors import ReadingError
from fieldlink.assess.readers.base import PERIOD_ROWS
from fieldlink.assess.readers.sql_description import LOOP, SqlTable
from fieldlink.assess.series import Series, without_repeats
from fieldlink.site.bad_numbers import drop_bad_numbers
from fieldlink.site.timestamps import typical_interval

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["MomentLoop", "ValueLoop"]

Floats = NDArray[np.float64]

_PAIRED = 0.5
"""Share of PV's moments that need a value of OP, as in files with a row for each value."""


class _Table(Protocol):
    """What a loop needs of its table."""

    description: SqlTable
    time: Column[Any]

    def column(self, name: str, key: str) -> Column[Any]: ...
    def rows(self, query: Select[Any]) -> Sequence[Any]: ...
    def between(self, query: Select[Any], since: float, until: float) -> Select[Any]: ...
    def moment(self, value: Any) -> float: ...
    def numbers(self, values: Sequence[Any]) -> Floats: ...
    def switch(self, values: Sequence[Any]) -> Floats: ...


class _Loop:
    """What both layouts share: where a loop begins and ends, and its period."""

    dated = True

    def __init__(
        self, table: _Table, key: Column[Any] | None, name: str, period: float | None
    ) -> None:
        self._table = table
        self._key = key
        ends = [
            table.rows(self._of(name, select(function(table.time))))[0][0]
            for function in (func.min, func.max)
        ]
        if ends[0] is None:
            raise ReadingError(f"the table has no rows of {name!r}; check the names")
        self._name = name
        self.first, self.last = (table.moment(end) for end in ends)
        query = self._of(name, select(table.time)).order_by(table.time).limit(PERIOD_ROWS)
        stamps = np.array([table.moment(row[0]) for row in table.rows(query)])
        given = period or table.description.period
        stamps = np.unique(stamps)
        several = stamps.size > 1
        own = typical_interval(stamps, np.arange(stamps.size)) if several else 1.0
        self.period = given or round(own, 6)

    def has_good_rows(self) -> bool:
        """Whether any row has a good quality; true without a column of quality."""
        if self._table.description.quality is None:
            return True
        query = self._good(self._of(self._name, select(self._table.time)))
        return bool(self._table.rows(query.limit(1)))

    def _of(self, name: str, query: Select[Any]) -> Select[Any]:
        # A row without a time is nowhere.
        query = query.where(self._table.time.is_not(None))
        return query if self._key is None else query.where(self._key == name)

    def _series(self, time: Floats, signals: Mapping[str, Floats]) -> Series:
        notes = drop_bad_numbers({role: signals.get(role) for role in ("op", "pv", "sp")})
        return Series(
            time=time,
            op=signals["op"],
            pv=signals["pv"],
            sp=signals.get("sp"),
            auto=signals.get("auto"),
            period=self.period,
            dated=True,
            notes=tuple(notes),
        )

    def _read(self, role: str, values: Sequence[Any]) -> Floats:
        return self._table.switch(values) if role == "auto" else self._table.numbers(values)

    def _good(self, query: Select[Any]) -> Select[Any]:
        about = self._table.description
        if about.quality is None:
            return query
        return query.where(self._table.column(about.quality, "quality").in_(about.good))


class MomentLoop(_Loop):
    """A loop whose OP and PV stand in one row."""

    def __init__(self, table: _Table, loop: str, period: float | None) -> None:
        about = table.description
        super().__init__(
            table, None if about.loop is None else table.column(about.loop, "loop"), loop, period
        )
        self._loop = loop
        roles = {"op": about.op, "pv": about.pv, "sp": about.sp, "auto": about.auto}
        self._columns = {
            role: table.column(name, role) for role, name in roles.items() if name is not None
        }

    def fetch(self, since: float, until: float, rows: int) -> Series:
        """At most ``rows`` samples from ``since`` on and before ``until``."""
        table = self._table
        query = self._good(self._of(self._loop, select(table.time, *self._columns.values())))
        found = table.rows(table.between(query, since, until).order_by(table.time).limit(rows))
        signals = {
            role: self._read(role, [row[number] for row in found])
            for number, role in enumerate(self._columns, start=1)
        }
        stamps = np.array([table.moment(row[0]) for row in found])
        return without_repeats(self._series(stamps, signals))


class ValueLoop(_Loop):
    """A loop whose signals are tags of their own, each value in a row."""

    def __init__(self, table: _Table, loop: str, period: float | None) -> None:
        about = table.description
        assert about.tags is not None
        assert about.tag is not None
        assert about.value is not None
        self._tags = {role: name.replace(LOOP, loop) for role, name in about.tags.named().items()}
        super().__init__(table, table.column(about.tag, "tag"), self._tags["pv"], period)
        self._value = table.column(about.value, "value")

    def fetch(self, since: float, until: float, rows: int) -> Series:
        """At most ``rows`` samples from ``since`` on and before ``until``, one a slot."""
        stamps, pv = self._values("pv", since, until, rows)
        if stamps.size == 0:
            nothing = np.zeros(0)
            return Series(nothing, nothing, nothing, None, None, self.period, dated=True)
        begin = float(stamps[0])
        count = min(rows, round((float(stamps[-1]) - begin) / self.period) + 1)
        end = begin + (count - 0.5) * self.period
        signals = {"pv": _placed(stamps, pv, begin, self.period, count)}
        for role in self._tags:
            if role == "op":
                at, values = self._values(role, begin - 0.5 * self.period, end, 2 * rows)
                signals[role] = _placed(at, values, begin, self.period, count)
            elif role != "pv":
                signals[role] = self._held(role, begin, end, count)
        series = self._series(begin + self.period * np.arange(count, dtype=np.float64), signals)
        known = {role: np.count_nonzero(~np.isnan(signals[role])) for role in ("op", "pv")}
        if known["op"] < _PAIRED * known["pv"]:
            note = (
                f"{self._tags['op']} has values at {known['op']} of the {known['pv']} moments of "
                f"{self._tags['pv']}: it is stored at another rate, or when it changes"
            )
            return replace(series, notes=(*series.notes, note))
        return series

    def _values(
        self, role: str, since: float, until: float, rows: int, *, newest: bool = False
    ) -> tuple[Floats, Floats]:
        table = self._table
        order = table.time.desc() if newest else table.time
        query = self._good(self._of(self._tags[role], select(table.time, self._value)))
        found = table.rows(table.between(query, since, until).order_by(order).limit(rows))
        stamps = np.array([table.moment(row[0]) for row in found])
        return stamps, self._read(role, [row[1] for row in found])

    def _held(self, role: str, begin: float, end: float, count: int) -> Floats:
        """Read a signal stored by change: each slot holds the last value before it."""
        before = self._values(role, -math.inf, begin, 1, newest=True)
        within = self._values(role, begin, end, 4 * count)
        stamps, values = (np.concatenate(pair) for pair in zip(before, within, strict=True))
        slots = begin + self.period * (np.arange(count) + 0.5)
        place = np.searchsorted(stamps, slots) - 1
        held = np.full(count, np.nan)
        held[place >= 0] = values[place[place >= 0]]
        return held


def _placed(stamps: Floats, values: Floats, begin: float, period: float, count: int) -> Floats:
    """Values in their slots, NaN in an empty one; of two in one slot the later counts."""
    placed = np.full(count, np.nan)
    slots = np.round((stamps - begin) / period).astype(np.int64)
    inside = (slots >= 0) & (slots < count)
    placed[slots[inside]] = values[inside]
    return placed
