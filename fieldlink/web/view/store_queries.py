"""What the pages ask of the store: small queries over one engine that stays open.

Every query goes by an index and brings at most a bounded number of rows, so that a year of a large
site is answered in a fraction of a second. Times are UTC milliseconds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import (
    ColumnElement,
    Engine,
    Select,
    Subquery,
    Table,
    and_,
    func,
    inspect,
    select,
)
from sqlalchemy.exc import SQLAlchemyError

from fieldlink.store.database import open_for_reading
from fieldlink.store.last_findings import CLOSED, newest_of_findings
from fieldlink.store.reading import reading_error
from fieldlink.store.schema import (
    DIAGNOSES,
    ESTIMATES,
    EVENTS,
    FINDINGS,
    SAMPLES,
    SLOTS,
    WRITEBACKS,
)
from fieldlink.web.view.newest_rows import ids_behind_blocks, newest_ids, stored_loops

__all__ = ["DAY_MS", "Row", "StoreQueries"]

Row = dict[str, Any]

DAY_MS = 86_400_000

_PLAIN = [
    ESTIMATES.c[name]
    for name in (
        "id",
        "loop",
        "window_end_ms",
        "verdict",
        "stick_band",
        "stick_band_low",
        "stick_band_high",
        "slip_jump",
        "slip_jump_low",
        "slip_jump_high",
    )
]
"""What a trend needs of an estimate."""


class StoreQueries:
    """Reads a historian.

    Args:
        url: its address.

    Raises:
        StoreError: there is no historian, or (by every method) it cannot be read.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        self._engine: Engine = open_for_reading(url)
        self._tables: frozenset[str] = frozenset()

    def close(self) -> None:
        """Close the connections."""
        self._engine.dispose()

    def loops(self) -> list[str]:
        """Return every loop that has samples or estimates, by name."""
        names: set[str] = set()
        for table in (ESTIMATES, SAMPLES):
            stored = stored_loops(table)
            found = self._rows(select(stored.c.loop).where(stored.c.loop.is_not(None)))
            names.update(row["loop"] for row in found)
        return sorted(names)

    def last_of(
        self, table: Table, loops: Sequence[str], *conditions: ColumnElement[bool]
    ) -> dict[str, Row]:
        """Return the last row of each loop that has one, by loop."""
        return self._rows_by_loop(table, newest_ids(table, loops, *conditions), loops)

    def last_accepted(self, loops: Sequence[str], since_ms: int) -> dict[str, Row]:
        """Return the last block of each loop that the PLC acknowledged since a moment."""
        return self.last_of(WRITEBACKS, loops, *_accepted(since_ms))

    def estimates_behind(self, loops: Sequence[str], since_ms: int) -> dict[str, Row]:
        """Return the estimate behind each loop's last block that the PLC acknowledged."""
        wanted = ids_behind_blocks(newest_ids(WRITEBACKS, loops, *_accepted(since_ms)))
        return self._rows_by_loop(ESTIMATES, wanted, loops)

    def last_estimates(self, loops: Sequence[str]) -> dict[str, Row]:
        """Return the last estimate of each loop, with its document."""
        return self.last_of(ESTIMATES, loops)

    def last_judged(self, loops: Sequence[str]) -> dict[str, Row]:
        """Return the last estimate with a verdict of each loop, with its document."""
        return self.last_of(ESTIMATES, loops, ESTIMATES.c.verdict.is_not(None))

    def last_attempts(self, loops: Sequence[str]) -> dict[str, Row]:
        """Return the last write-back attempt or decision of each loop."""
        return self.last_of(WRITEBACKS, loops)

    def last_samples(self, loops: Sequence[str]) -> dict[str, Row]:
        """Return the last sample of each loop."""
        return self.last_of(SAMPLES, loops)

    def last_slots(self, loops: Sequence[str]) -> dict[str, Row]:
        """Return the last account of slots of each loop."""
        return self.last_of(SLOTS, loops)

    def estimates_after(self, last_id: int) -> list[Row]:
        """Return the estimates stored after a row, oldest first, with their documents."""
        return self._rows(
            select(ESTIMATES).where(ESTIMATES.c.id > last_id).order_by(ESTIMATES.c.id)
        )

    def attempts_after(self, last_id: int) -> list[Row]:
        """Return the write-back attempts and decisions stored after a row, oldest first."""
        return self._rows(
            select(WRITEBACKS).where(WRITEBACKS.c.id > last_id).order_by(WRITEBACKS.c.id)
        )

    def newest_id(self, table: Table) -> int:
        """Return the highest row number of a table, 0 when it is empty."""
        return int(next(iter(self._rows(select(func.max(table.c.id)))[0].values())) or 0)

    def thinned_estimates(self, since_ms: int, bucket_ms: int, loop: str = "") -> list[Row]:
        """Return the last estimate of each loop in each bucket of time: what a trend needs of it.

        Args:
            since_ms: from when on.
            bucket_ms: length of a bucket.
            loop: only this loop; all when empty.
        """
        c = ESTIMATES.c
        wanted = c.utc_ms >= since_ms if not loop else and_(c.loop == loop, c.utc_ms >= since_ms)
        last = (
            select(func.max(c.id).label("id"))
            .where(wanted)
            .group_by(c.loop, c.utc_ms // bucket_ms)
            .subquery()
        )
        query = select(*_PLAIN).join(last, c.id == last.c.id).order_by(c.id)
        return self._rows(query)

    def newest_estimates(self, most: int) -> list[Row]:
        """Return the newest estimates of all loops: what a trend needs of them."""
        c = ESTIMATES.c
        return self._rows(select(*_PLAIN).where(c.id > self.newest_id(ESTIMATES) - most))

    def attempts(self, loop: str, most: int) -> list[Row]:
        """Return the newest write-back attempts and decisions of a loop, newest first."""
        c = WRITEBACKS.c
        query = select(WRITEBACKS).where(c.loop == loop).order_by(c.utc_ms.desc(), c.id.desc())
        return self._rows(query.limit(most))

    def accepted_blocks(self, loop: str, most: int) -> list[Row]:
        """Return the newest blocks that the PLC acknowledged, newest first."""
        c = WRITEBACKS.c
        query = (
            select(WRITEBACKS)
            .where(c.loop == loop, c.outcome == "accepted")
            .order_by(c.utc_ms.desc(), c.id.desc())
        )
        return self._rows(query.limit(most))

    def events(self, kinds: str, since_ms: int, most: int, source: str = "") -> list[Row]:
        """Return the newest events of a kind, newest first.

        Args:
            kinds: start of the kind, such as ``operator.``.
            since_ms: from when on.
            most: rows.
            source: only of this source; of all when empty.
        """
        c = EVENTS.c
        query = select(EVENTS).where(c.utc_ms >= since_ms, c.kind.startswith(kinds))
        if source:
            query = query.where(c.source == source)
        return self._rows(query.order_by(c.utc_ms.desc(), c.id.desc()).limit(most))

    def last_diagnoses(self, loops: Sequence[str]) -> dict[str, Row]:
        """Return the last diagnosis of each loop; none in a store of an earlier release."""
        if not self._has(DIAGNOSES):
            return {}
        return self.last_of(DIAGNOSES, loops, DIAGNOSES.c.cause.is_not(None))

    def diagnoses_after(self, last_id: int) -> list[Row]:
        """Return the diagnoses stored after a row, oldest first."""
        if not self._has(DIAGNOSES):
            return []
        c = DIAGNOSES.c
        return self._rows(select(DIAGNOSES).where(c.id > last_id).order_by(c.id))

    def newest_findings(self, since_ms: int) -> list[Row]:
        """Return each finding as its newest row says: the open ones and those closed lately.

        Args:
            since_ms: closed findings from when on.
        """
        if not self._has(FINDINGS):
            return []
        c = FINDINGS.c
        query = newest_of_findings().where((c.state != CLOSED) | (c.utc_ms >= since_ms))
        return self._rows(query.order_by(c.utc_ms.desc(), c.id.desc()))

    def course_of_finding(self, finding: str) -> list[Row]:
        """Return all rows of a finding, oldest first."""
        c = FINDINGS.c
        query = select(FINDINGS).where(c.finding == finding).order_by(c.utc_ms, c.id)
        return self._rows(query) if self._has(FINDINGS) else []

    def _has(self, table: Table) -> bool:
        """Whether a table exists; once it does it stays."""
        if table.name not in self._tables:
            try:
                self._tables = frozenset(inspect(self._engine).get_table_names())
            except SQLAlchemyError as error:
                raise reading_error(self._engine, self._url, error) from error
        return table.name in self._tables

    def sample_count(self, loop: str, since_ms: int, until_ms: int) -> int:
        """Return the number of samples of a loop in a range of time."""
        query = select(func.count()).where(_within(loop, since_ms, until_ms))
        return int(next(iter(self._rows(query.select_from(SAMPLES))[0].values())))

    def samples(self, loop: str, since_ms: int, until_ms: int, most: int) -> list[Row]:
        """Return the newest samples of a loop in a range of time, oldest first."""
        c = SAMPLES.c
        query = (
            select(c.utc_ms, c.slot, c.op, c.pv, c.sp, c.auto)
            .where(_within(loop, since_ms, until_ms))
            .order_by(c.utc_ms.desc(), c.id.desc())
        )
        return self._rows(query.limit(most))[::-1]

    def extremes(self, loop: str, since_ms: int, until_ms: int, bucket_ms: int) -> list[Row]:
        """Return least and greatest OP, PV and SP of each bucket of time, oldest first."""
        c = SAMPLES.c
        bucket = (c.utc_ms // bucket_ms).label("bucket")
        columns = [
            function(c[name]).label(f"{name}_{label}")
            for name in ("op", "pv", "sp")
            for label, function in (("low", func.min), ("high", func.max))
        ]
        query = (
            select(bucket, *columns)
            .where(_within(loop, since_ms, until_ms))
            .group_by(bucket)
            .order_by(bucket)
        )
        return self._rows(query)

    def window(self, row: Mapping[str, Any]) -> list[Row]:
        """Return the samples of the window that an estimate judged, oldest first."""
        c = SAMPLES.c
        query = (
            select(c.utc_ms, c.slot, c.op, c.pv, c.sp, c.auto)
            .where(
                c.loop == row["loop"],
                c.utc_ms <= row["window_end_ms"] + 1000,
                c.slot.between(row["first_slot"], row["last_slot"]),
            )
            .order_by(c.utc_ms.desc(), c.id.desc())
        )
        return self._rows(query.limit(row["last_slot"] - row["first_slot"] + 1))[::-1]

    def _rows_by_loop(self, table: Table, wanted: Subquery, loops: Sequence[str]) -> dict[str, Row]:
        if not loops:
            return {}
        asked, found = set(loops), table.alias()
        rows = self._rows(select(found).join(wanted, found.c.id == wanted.c.id))
        return {row["loop"]: row for row in rows if row["loop"] in asked}

    def _connection(self) -> Any:
        return self._engine.connect()

    def _rows(self, query: Select[Any]) -> list[Row]:
        try:
            with self._connection() as connection:
                found = connection.execute(query)
                # Row by row through SQLAlchemy's own mappings takes five times as long.
                names = tuple(found.keys())
                return [dict(zip(names, row, strict=True)) for row in found]
        except SQLAlchemyError as error:
            raise reading_error(self._engine, self._url, error) from error


def _accepted(since_ms: int) -> tuple[ColumnElement[bool], ...]:
    return WRITEBACKS.c.outcome == "accepted", WRITEBACKS.c.utc_ms > since_ms


def _within(loop: str, since_ms: int, until_ms: int) -> ColumnElement[bool]:
    c = SAMPLES.c
    return and_(c.loop == loop, c.utc_ms >= since_ms, c.utc_ms <= until_ms)
