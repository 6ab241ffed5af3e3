"""Reading a historian loop by loop for a whole fleet: one connection, no document more than needed.

A year of daily estimates of 200 loops is 73,000 documents; a fleet view needs 200 of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from sqlalchemy import Column, Select, Table, func, inspect, select
from sqlalchemy.exc import SQLAlchemyError

from fieldlink.store.database import open_for_reading
from fieldlink.store.former_names import FormerNames
from fieldlink.store.last_findings import newest_of_findings
from fieldlink.store.queries import frame_of
from fieldlink.store.reading import reading_error
from fieldlink.store.schema import (
    DIAGNOSES,
    ESTIMATES,
    EVENTS,
    FINDINGS,
    SAMPLES,
    SLOTS,
    WORK,
    WRITEBACKS,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["SAME_BAND", "FleetReader"]

SAME_BAND = 1e-5
"""Relative difference of two stick bands that are one: a block holds them as single floats."""

_COURSE = (
    "loop", "utc_ms", "window_end_ms", "first_slot", "last_slot", "outcome", "verdict", "score",
    "stick_band", "stick_band_low", "stick_band_high", "slip_jump", "slip_jump_low",
    "slip_jump_high", "confidence",
)  # fmt: skip


class FleetReader:
    """An open historian; use it in a ``with`` statement.

    Frames have ``utc_ms`` replaced by ``time`` (UTC), oldest row first. Every method raises
    `StoreError` when the historian cannot be read. What a loop did under former names is its own.

    Raises:
        StoreError: there is no historian.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        self._engine = open_for_reading(url)
        self._former_names: FormerNames | None = None

    @property
    def _names(self) -> FormerNames:
        if self._former_names is None:
            self._former_names = FormerNames.of_rows(self._rows(FormerNames.query()))
        return self._former_names

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._engine.dispose()

    def loops(self) -> tuple[str, ...]:
        """Return the loops that have estimates, by name."""
        c = ESTIMATES.c
        query = select(c.loop, func.max(c.utc_ms).label("last")).group_by(c.loop)
        return tuple(
            sorted({self._names.at_present(row.loop, row.last) for row in self._rows(query)})
        )

    def course(self, loop: str) -> pd.DataFrame:
        """Return the estimates of a loop without their documents."""
        columns = [ESTIMATES.c[name] for name in _COURSE]
        query = select(*columns).where(self._names.own(ESTIMATES, loop))
        return self._frame(query.order_by(ESTIMATES.c.utc_ms, ESTIMATES.c.id), columns)

    def documents(
        self, loop: str, *, until: datetime | None = None, last: int = 1
    ) -> list[dict[str, Any]]:
        """Return the newest estimates of a loop with a verdict, newest first.

        Each has ``document`` (the estimator's whole result) and the columns of `course`, with
        times as milliseconds since 1970.
        """
        columns = [*(ESTIMATES.c[name] for name in _COURSE), ESTIMATES.c.document]
        own = self._names.own(ESTIMATES, loop)
        query = select(*columns).where(own, ESTIMATES.c.verdict.is_not(None))
        if until is not None:
            query = query.where(ESTIMATES.c.window_end_ms <= round(1000.0 * until.timestamp()))
        query = query.order_by(ESTIMATES.c.utc_ms.desc(), ESTIMATES.c.id.desc()).limit(last)
        return [dict(row._mapping) for row in self._rows(query)]

    def valve_in_use(self, loop: str) -> dict[str, Any] | None:
        """Return the estimate behind the model that the PLC accepted last.

        None without such a block, or where a later one says anything else than a sticky valve. The
        columns are those of `documents`, and ``accepted_ms`` is when the PLC accepted the block.
        """
        b, c = WRITEBACKS.c, ESTIMATES.c
        # A block that is not assessable leaves the one before it in force.
        own = self._names.own(WRITEBACKS, loop)
        accepted = (own, b.outcome == "accepted", b.status != "not_assessable")
        query = select(b.utc_ms, b.status, b.stick_band).where(*accepted)
        blocks = self._rows(query.order_by(b.id.desc()).limit(1))
        if not blocks or blocks[0].status != "valid":
            return None
        S = blocks[0].stick_band
        same = c.stick_band.between(S * (1.0 - SAME_BAND), S * (1.0 + SAME_BAND))
        columns = [*(c[name] for name in _COURSE), c.document]
        judged = self._names.own(ESTIMATES, loop)
        behind = select(*columns).where(judged, c.verdict == "stiction", same)
        rows = self._rows(behind.order_by(c.id.desc()).limit(1))
        return {**rows[0]._mapping, "accepted_ms": blocks[0].utc_ms} if rows else None

    def last_write(self, loop: str, outcome: str | None = None) -> dict[str, Any] | None:
        """Return the newest write-back attempt or decision of a loop, of an outcome if given."""
        c = WRITEBACKS.c
        query = select(WRITEBACKS).where(self._names.own(WRITEBACKS, loop))
        if outcome is not None:
            query = query.where(c.outcome == outcome)
        rows = self._rows(query.order_by(c.utc_ms.desc(), c.id.desc()).limit(1))
        return dict(rows[0]._mapping) if rows else None

    def slot_counts(self) -> dict[str, dict[str, int]]:
        """Return by loop how many slots were expected, read, late, missed and bad in all."""
        c = SLOTS.c
        names = ("expected", "read", "late", "missed", "bad")
        sums = [func.sum(c[name]).label(name) for name in names]
        rows = self._rows(select(c.loop, *sums).group_by(c.loop))
        return {row.loop: {name: int(row._mapping[name]) for name in names} for row in rows}

    def last_stored(self) -> tuple[int, ...]:
        """Return the stamps of the rows stored last: event, account, estimate, write-back."""
        found: list[int] = []
        for table in (EVENTS, SLOTS, ESTIMATES, WRITEBACKS):
            rows = self._rows(select(table.c.utc_ms).order_by(table.c.id.desc()).limit(1))
            found.extend(int(row.utc_ms) for row in rows)
        return tuple(found)

    def samples(self, loop: str, count: int, *, until: datetime | None = None) -> pd.DataFrame:
        """Return the newest ``count`` samples of a loop, or the newest up to ``until``."""
        columns = [SAMPLES.c[name] for name in ("utc_ms", "slot", "op", "pv", "sp", "auto")]
        query = select(*columns).where(self._names.own(SAMPLES, loop))
        if until is not None:
            query = query.where(SAMPLES.c.utc_ms <= round(1000.0 * until.timestamp()))
        query = query.order_by(SAMPLES.c.utc_ms.desc(), SAMPLES.c.id.desc()).limit(count)
        frame = self._frame(query, columns).iloc[::-1].reset_index(drop=True)
        numbers = ["op", "pv", "sp"]
        frame[numbers] = frame[numbers].astype("float64")
        return frame

    def work(self) -> list[dict[str, Any]]:
        """Return what people have said about the work; nothing in a store of an earlier release.

        Rows are dictionaries with ``time`` (UTC) instead of ``utc_ms``, in the order in which they
        were said: a repair entered afterwards (``--at``) is older than what was said before, and is
        the last word all the same.
        """
        if not self._has(WORK):
            return []
        columns = [column for column in WORK.columns if column.name != "id"]
        return self._records(select(*columns).order_by(WORK.c.id), "loop")

    def events(self, kinds: Sequence[str]) -> list[dict[str, Any]]:
        """Return the events of some kinds about loops; rows as of `work`."""
        columns = [EVENTS.c[name] for name in ("utc_ms", "kind", "source", "message")]
        query = select(*columns).where(EVENTS.c.kind.in_(kinds))
        return self._records(query.order_by(EVENTS.c.utc_ms, EVENTS.c.id), "source")

    def diagnosis(self, loop: str) -> dict[str, Any] | None:
        """Return the newest diagnosis of a loop; None without one."""
        if not self._has(DIAGNOSES):
            return None
        c = DIAGNOSES.c
        query = select(DIAGNOSES).where(self._names.own(DIAGNOSES, loop), c.cause.is_not(None))
        rows = self._rows(query.order_by(c.utc_ms.desc(), c.id.desc()).limit(1))
        return dict(rows[0]._mapping) if rows else None

    def findings(self) -> list[dict[str, Any]]:
        """Return every finding as its newest row says; nothing in a store of an earlier release."""
        if not self._has(FINDINGS):
            return []
        query = newest_of_findings().order_by(FINDINGS.c.born_ms, FINDINGS.c.finding)
        return [dict(row._mapping) for row in self._rows(query)]

    def _has(self, table: Table) -> bool:
        try:
            return inspect(self._engine).has_table(table.name)
        except SQLAlchemyError as error:
            raise reading_error(self._engine, self._url, error) from error

    def _frame(self, query: Select[Any], columns: Sequence[Column[Any]]) -> pd.DataFrame:
        return frame_of([row._mapping for row in self._rows(query)], columns)

    def _records(self, query: Select[Any], named: str) -> list[dict[str, Any]]:
        """Return rows with the present name of their loop in the column ``named``."""
        records = [dict(row._mapping) for row in self._rows(query)]
        for record in records:
            record[named] = self._names.at_present(record[named], record["utc_ms"])
        return [
            {"time": datetime.fromtimestamp(record.pop("utc_ms") / 1000.0, UTC)} | record
            for record in records
        ]

    def _rows(self, query: Select[Any]) -> Sequence[Any]:
        try:
            with self._engine.connect() as connection:
                return connection.execute(query).all()
        except SQLAlchemyError as error:
            raise reading_error(self._engine, self._url, error) from error
