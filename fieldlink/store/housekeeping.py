"""What is kept and for how long: samples become averages, averages end, and the size has a bound.

A sweep is a row of small transactions, so that the thread that makes them can store samples in
between. Each takes the oldest samples of one loop. Estimates, write-backs, events and the accounts
of slots are few and never removed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import structlog
from sqlalchemy import (
    ColumnElement,
    Connection,
    Engine,
    Table,
    case,
    delete,
    func,
    insert,
    literal,
    select,
    text,
)

from fieldlink.store.records import EventRecord
from fieldlink.store.schema import AVERAGES, SAMPLES

__all__ = ["Housekeeping", "Retention", "RetentionClock"]

_log = structlog.get_logger(__name__)

DAY = 86400.0
HOUR_MS = 3_600_000
STEP_MS = 2 * HOUR_MS
"""Time whose samples one transaction takes, unless an average is longer."""

LOW_WATER = 0.9
"""Share of the largest size at which making room ends."""

SAMPLE_BYTES = 100
"""Bytes that a sample takes with its place in the index, see docs/operations.md."""


@dataclass(frozen=True, slots=True)
class Retention:
    """How long records are kept, and how large the file may grow.

    Attributes:
        samples_days: days that samples are kept; for ever when None.
        average_minutes: length of the averages that older samples become; they are dropped when
            None.
        averages_days: days that averages are kept; for ever when None.
        max_bytes: size of an SQLite historian above which the oldest samples go before their time,
            and the oldest averages once less than a day of samples is left; no bound when None.
    """

    samples_days: float | None = None
    average_minutes: float | None = None
    averages_days: float | None = None
    max_bytes: int | None = None

    @property
    def bucket_ms(self) -> int:
        """Milliseconds of an average; a minute where there are none."""
        return max(1, round(60_000.0 * (self.average_minutes or 1.0)))


class RetentionClock:
    """The time by which data grow old: a wall clock that steps forward is not believed at once.

    A clock that jumps to the year 2099 would otherwise empty the store. It is believed again when
    it has gone on without a further step for a day. A process that begins does not know whether the
    clock stepped before: see `begin`.

    Args:
        wall, monotonic: seconds; the machine's own clocks unless given.
    """

    def __init__(
        self,
        wall: Callable[[], float] = time.time,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._wall = wall
        self._monotonic = monotonic
        self._anchor = wall() - monotonic()
        self._ahead: tuple[float, float] | None = None

    def begin(self, newest: float) -> None:
        """Take what the clock is ahead of the newest stored data for a step.

        Args:
            newest: when those were stored, seconds since 1970. Nobody knows whether the process
                ended so long ago or the clock is wrong: either is believed after a day.
        """
        self._anchor = min(self._anchor, newest - self._monotonic())

    def now(self) -> float:
        """Seconds since 1970, without steps of the clock into the future."""
        elapsed = self._monotonic()
        offset = self._wall() - elapsed
        if offset <= self._anchor + 60.0:
            self._anchor, self._ahead = offset, None
        elif self._ahead is None or abs(offset - self._ahead[0]) > 60.0:
            self._ahead = (offset, elapsed)
        elif elapsed - self._ahead[1] > DAY:
            self._anchor, self._ahead = offset, None
        return self._anchor + elapsed


class Housekeeping:
    """Keeps a historian within its retention.

    Args:
        retention: what is kept.
        clock: the time by which data grow old.
    """

    def __init__(self, retention: Retention, clock: RetentionClock | None = None) -> None:
        self._retention = retention
        self._clock = clock or RetentionClock()

    def begin(self, engine: Engine) -> None:
        """Let the clock begin with what is stored; to be called before samples are added."""
        if self._retention.samples_days is None and self._retention.averages_days is None:
            return
        newest = _newest(engine, SAMPLES)
        if newest is not None:
            self._clock.begin(newest / 1000.0)

    def sweep(self, engine: Engine) -> Iterator[int]:
        """Do what is due, one transaction for every item; yields the rows that each removed."""
        wanted = self._retention
        now = self._clock.now()
        samples = averages = 0
        if wanted.samples_days is not None:
            for rows in self._thin(engine, _ms(now - DAY * wanted.samples_days)):
                samples += rows
                yield rows
        if wanted.averages_days is not None:
            for rows in self._end_averages(engine, _ms(now - DAY * wanted.averages_days)):
                averages += rows
                yield rows
        if wanted.max_bytes is not None and engine.dialect.name == "sqlite":
            yield from self._make_room(engine, wanted.max_bytes, _ms(now))
        if samples or averages:
            _log.info("store.pruned", samples=samples, averages=averages)

    def _thin(self, engine: Engine, before: int) -> Iterator[int]:
        """Turn samples from before ``before`` into averages, or into nothing."""
        bucket = self._retention.bucket_ms
        before -= before % bucket
        step = max(bucket, STEP_MS - STEP_MS % bucket)
        for loop in _loops(engine, SAMPLES):
            while True:
                with engine.begin() as connection:
                    first = _first(connection, SAMPLES, loop)
                    if first is None or first >= before:
                        break
                    start = first - first % bucket
                    end = min(before, start + step)
                    if self._retention.average_minutes is not None:
                        _average(connection, loop, start, end, bucket)
                    removed = _remove(connection, SAMPLES, loop, end)
                yield removed

    def _end_averages(self, engine: Engine, before: int) -> Iterator[int]:
        for loop in _loops(engine, AVERAGES):
            with engine.begin() as connection:
                removed = _remove(connection, AVERAGES, loop, before)
            if removed:
                yield removed

    def _make_room(self, engine: Engine, largest: int, now: int) -> Iterator[int]:
        used = _used_bytes(engine)
        if used <= largest:
            yield from _give_back(engine)
            return
        removed, wanted = 0, LOW_WATER * largest
        while used > wanted:
            rows = 0
            for count in self._oldest_part(engine, now, used - wanted):
                rows += count
                yield count
            removed += rows
            if rows == 0:
                break
            used = _used_bytes(engine)
        _tell_of_bound(engine, used, largest, removed)
        yield from _give_back(engine)

    def _oldest_part(self, engine: Engine, now: int, too_much: float) -> Iterator[int]:
        """Remove a twentieth of the time that there is, samples while there is a day of them.

        The last day of them goes only where that makes the room: estimates that are above the bound
        by themselves, and are never removed, must not cost every sample.
        """
        oldest = _oldest(engine, SAMPLES)
        floor = _oldest(engine, AVERAGES)
        day = round(1000.0 * DAY)
        helps = floor is None and SAMPLE_BYTES * _sample_count(engine) >= too_much
        if oldest is not None and (now - oldest > day or helps):
            part = max(self._retention.bucket_ms, (now - oldest) // 20)
            yield from self._thin(engine, oldest + part + self._retention.bucket_ms)
        elif floor is not None:
            yield from self._end_averages(engine, floor + max(day, (now - floor) // 20))


def _ms(seconds: float) -> int:
    return round(1000.0 * seconds)


def _loops(engine: Engine, table: Table) -> Iterator[str]:
    """Give the loops that have rows; each is one look into the index."""
    last: str | None = None
    while True:
        query = select(func.min(table.c.loop))
        if last is not None:
            query = query.where(table.c.loop > last)
        with engine.connect() as connection:
            last = connection.scalar(query)
        if last is None:
            return
        yield last


def _first(connection: Connection, table: Table, loop: str) -> int | None:
    first = connection.scalar(select(func.min(table.c.utc_ms)).where(table.c.loop == loop))
    return None if first is None else int(first)


def _oldest(engine: Engine, table: Table) -> int | None:
    with engine.connect() as connection:
        firsts = [_first(connection, table, loop) for loop in _loops(engine, table)]
    return min((first for first in firsts if first is not None), default=None)


def _newest(engine: Engine, table: Table) -> int | None:
    query = select(func.max(table.c.utc_ms))
    with engine.connect() as connection:
        lasts = [connection.scalar(query.where(table.c.loop == x)) for x in _loops(engine, table)]
    return max((int(last) for last in lasts if last is not None), default=None)


def _remove(connection: Connection, table: Table, loop: str, before: int) -> int:
    where = (table.c.loop == loop) & (table.c.utc_ms < before)
    return int(connection.execute(delete(table).where(where)).rowcount)


def _average(connection: Connection, loop: str, start: int, end: int, bucket: int) -> None:
    """Store the averages of a loop's samples from ``start`` to ``end``, which bound buckets."""
    s = SAMPLES.c
    begin = s.utc_ms - s.utc_ms % literal(bucket)
    columns: dict[str, ColumnElement[Any]] = {
        "loop": s.loop,
        "utc_ms": begin,
        "length_ms": literal(bucket),
        "samples": func.count(s.id),
        "good": func.sum(case((s.quality == 0, 1), else_=0)),
        "sp_mean": func.avg(s.sp),
        "auto_share": func.avg(case((s.auto.is_(True), 1.0), (s.auto.is_(False), 0.0))),
    }
    for name in ("op", "pv"):
        signal = s[name]
        variance = func.avg(signal * signal) - func.avg(signal) * func.avg(signal)
        columns |= {
            f"{name}_mean": func.avg(signal),
            f"{name}_min": func.min(signal),
            f"{name}_max": func.max(signal),
            # Rounding may leave less than nothing of a constant signal's variance.
            f"{name}_std": case((variance > 0.0, func.sqrt(variance)), (variance <= 0.0, 0.0)),
        }
    query = (
        select(*(column.label(name) for name, column in columns.items()))
        .where(s.loop == loop, s.utc_ms >= start, s.utc_ms < end)
        .group_by(s.loop, text("2"))
    )
    connection.execute(insert(AVERAGES).from_select(list(columns), query))


def _sample_count(engine: Engine) -> int:
    """About as many samples as there are: rows are numbered, and the oldest are removed first."""
    with engine.connect() as connection:
        first, last = connection.execute(
            select(func.min(SAMPLES.c.id), func.max(SAMPLES.c.id))
        ).one()
    return 0 if last is None else int(last - first + 1)


def _tell_of_bound(engine: Engine, used: int, largest: int, removed: int) -> None:
    """Log and store that the bound was reached, and what it takes where it cannot be kept."""
    said = f"historian.max_megabytes = {largest / 1e6:g} is reached; {removed} old rows went; "
    if used > largest:
        said += (
            f"{used / 1e6:.0f} MB are left, most of them estimates and diagnoses, which are always "
            "kept: raise max_megabytes, make estimates rarer (estimate_every, findings.every), or "
            "begin a new file (historian.url)"
        )
    else:
        said += "raise it, or lower retention_days"
    _log.warning("store.at_its_bound", message=said)
    record = EventRecord(round(1000.0 * time.time()), "store.at_its_bound", "store", said)
    with engine.begin() as connection:
        connection.execute(insert(record.table), record.row())


def _used_bytes(engine: Engine) -> int:
    with engine.connect() as connection:
        pages, free, size = (
            int(connection.exec_driver_sql(f"PRAGMA {name}").scalar_one())
            for name in ("page_count", "freelist_count", "page_size")
        )
    return (pages - free) * size


def _give_back(engine: Engine) -> Iterator[int]:
    """Return free pages to the file system, some megabytes a transaction."""
    while True:
        with engine.connect() as connection:
            free = int(connection.exec_driver_sql("PRAGMA freelist_count").scalar_one())
            mode = int(connection.exec_driver_sql("PRAGMA auto_vacuum").scalar_one())
            if free < 1000 or mode != 2:
                return
            connection.exec_driver_sql("PRAGMA incremental_vacuum(1000)").fetchall()
            connection.commit()
        yield 0
