"""The historian: a thread that writes what the daemon hands it, so that the daemon never waits.

Records go into a bounded queue and reach the database in batches, one transaction each. While the
database cannot be written, the batch is kept and tried again; when the queue is full meanwhile, the
newest samples are dropped, counted and said. Estimates, write-backs and events have room of their
own at the end of the queue, because they are few and the record of what was done to a plant.
"""

from __future__ import annotations

import math
import queue
import threading
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import structlog
from sqlalchemy import Engine, delete, insert
from sqlalchemy.exc import OperationalError, SQLAlchemyError

from fieldlink.store.database import open_for_writing
from fieldlink.store.records import EventRecord, Record, SampleRecord
from fieldlink.store.schema import SAMPLES

__all__ = ["Historian", "HistorianSettings", "StoreReport"]

_log = structlog.get_logger(__name__)


@dataclass(frozen=True, slots=True)
class HistorianSettings:
    """How much to hold and how patient to be.

    Attributes:
        queue: records that may wait; samples may fill nine tenths of it.
        batch: the most records in one transaction.
        linger: seconds to wait for more records before a batch is written.
        retry: seconds between attempts while the database cannot be written.
        busy_timeout: seconds one attempt waits for another program's lock.
        flush: seconds that stopping may take.
        prune: seconds between two removals of samples that are older than the retention.
    """

    queue: int = 200_000
    batch: int = 2_000
    linger: float = 0.2
    retry: float = 1.0
    busy_timeout: float = 5.0
    flush: float = 20.0
    prune: float = 3600.0


@dataclass(frozen=True, slots=True)
class StoreReport:
    """What became of the records so far.

    Attributes:
        written: rows in the database.
        dropped: records lost because the queue was full, a row was refused, or stopping took too
            long.
        waiting: records in the queue.
        retries: attempts that failed and were repeated.
        last_error: the last failure's text, empty when there was none.
    """

    written: int = 0
    dropped: int = 0
    waiting: int = 0
    retries: int = 0
    last_error: str = ""


class Historian:
    """Writes records to a database from a thread of its own.

    Args:
        url: SQLAlchemy address.
        settings: sizes and patience.
        retention_days: days by the wall clock that samples are kept; for ever when None. Estimates,
            write-backs and events are always kept.
    """

    def __init__(
        self,
        url: str,
        settings: HistorianSettings | None = None,
        *,
        retention_days: float | None = None,
    ) -> None:
        self._url = url
        self._retention_days = retention_days
        self._pruned_at = -math.inf
        self._settings = settings or HistorianSettings()
        self._queue: queue.Queue[Record] = queue.Queue(self._settings.queue)
        self._samples_stop_at = int(0.9 * self._settings.queue)
        self._lock = threading.Lock()
        self._written = self._dropped = self._retries = self._in_hand = 0
        self._last_error = ""
        self._overflowing = False
        self._stopping = threading.Event()
        self._deadline = float("inf")
        self._thread: threading.Thread | None = None

    def start(self, opened: EventRecord) -> None:
        """Open the database, store ``opened`` in it, and begin to write.

        Raises:
            StoreError: see `open_for_writing`.
        """
        engine = open_for_writing(self._url, opened, self._settings.busy_timeout)
        self._written += 1
        self._thread = threading.Thread(
            target=self._run, args=(engine,), name="historian", daemon=True
        )
        self._thread.start()

    def put(self, record: Record, *, wait: bool = False) -> bool:
        """Hand over a record; returns at once, False when there was no room for it.

        With ``wait`` it waits for room instead, for runs that are faster than any disk.
        """
        if wait:
            self._queue.put(record)
            return True
        room = not (
            isinstance(record, SampleRecord) and self._queue.qsize() >= self._samples_stop_at
        )
        if room:
            try:
                self._queue.put_nowait(record)
            except queue.Full:
                room = False
        if not room:
            self._drop(1)
        waiting = self._queue.qsize()
        if not room and not self._overflowing:
            self._overflowing = True
            _log.error("store.overflow", waiting=waiting, error=self._last_error)
        elif self._overflowing and waiting < 0.5 * self._samples_stop_at:
            self._overflowing = False
            _log.info("store.overflow_over", dropped=self._dropped)
        return room

    def report(self) -> StoreReport:
        """Return the counts up to now."""
        with self._lock:
            return StoreReport(
                self._written,
                self._dropped,
                self._queue.qsize() + self._in_hand,
                self._retries,
                self._last_error,
            )

    def stop(self) -> StoreReport:
        """Write everything that waits, close the database, and return the final counts.

        Blocks for at most ``settings.flush`` seconds and one attempt; what could not be written by
        then is counted as dropped.
        """
        if self._thread is not None:
            self._deadline = time.monotonic() + self._settings.flush
            self._stopping.set()
            self._thread.join()
            self._thread = None
        report = self.report()
        if report.dropped:
            _log.error("store.lost", records=report.dropped, error=report.last_error)
        return report

    def _run(self, engine: Engine) -> None:
        try:
            while batch := self._next_batch():
                self._write(engine, batch)
                self._prune(engine)
        finally:
            engine.dispose()

    def _next_batch(self) -> list[Record]:
        """Wait for records; empty only when stopping and nothing is left."""
        batch: list[Record] = []
        while not batch:
            try:
                batch.append(self._queue.get(timeout=self._settings.linger))
            except queue.Empty:
                if self._stopping.is_set():
                    return batch
        if not self._stopping.is_set():
            self._stopping.wait(self._settings.linger)
        while len(batch) < self._settings.batch:
            try:
                batch.append(self._queue.get_nowait())
            except queue.Empty:
                break
        with self._lock:
            self._in_hand = len(batch)
        return batch

    def _write(self, engine: Engine, batch: Sequence[Record]) -> None:
        failed = False
        while True:
            try:
                written = _insert(engine, batch)
            except OperationalError as error:
                # Locked, full, unplugged: it may pass, so nothing is given up yet.
                self._note_failure(error, first=not failed)
                failed = True
                if time.monotonic() >= self._deadline:
                    self._drop(len(batch))
                    break
                wait = self._settings.retry
                if self._stopping.is_set():
                    time.sleep(min(wait, 0.05))
                else:
                    self._stopping.wait(wait)
                continue
            except SQLAlchemyError as error:
                # Not the database but a record is wrong: the others must not suffer.
                self._note_failure(error, first=True)
                if len(batch) > 1:
                    for record in batch:
                        self._write(engine, [record])
                else:
                    self._drop(1)
                break
            with self._lock:
                self._written += written
            if failed:
                _log.info("store.writable_again", retries=self._retries)
            break
        with self._lock:
            self._in_hand = 0

    def _prune(self, engine: Engine) -> None:
        """Remove samples that are older than the retention, now and then."""
        now = time.monotonic()
        if self._retention_days is None or now - self._pruned_at < self._settings.prune:
            return
        self._pruned_at = now
        oldest = round(1000.0 * (time.time() - 86400.0 * self._retention_days))
        try:
            with engine.begin() as connection:
                removed = connection.execute(delete(SAMPLES).where(SAMPLES.c.utc_ms < oldest))
        except OperationalError as error:
            # The next round removes them, too.
            self._note_failure(error, first=True)
        else:
            _log.info("store.pruned", samples=removed.rowcount, days=self._retention_days)

    def _note_failure(self, error: SQLAlchemyError, *, first: bool) -> None:
        cause = str(getattr(error, "orig", None) or error)
        with self._lock:
            self._retries += 1
            self._last_error = cause
        if first:
            _log.error("store.cannot_write", error=cause, waiting=self._queue.qsize())

    def _drop(self, count: int) -> None:
        with self._lock:
            self._dropped += count


def _insert(engine: Engine, batch: Sequence[Record]) -> int:
    """Insert all of ``batch`` in one transaction."""
    by_table = defaultdict(list)
    for record in batch:
        by_table[record.table].append(record.row())
    with engine.begin() as connection:
        for table, rows in by_table.items():
            connection.execute(insert(table), rows)
    return len(batch)
