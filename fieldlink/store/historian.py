"""The historian: a thread that writes what the daemon hands it, so that the daemon never waits.

Records go into a bounded queue and reach the database in batches, one transaction each. While the
database cannot be written, the batch is kept and tried again; when the queue is full meanwhile, the
newest samples are dropped, counted and said. Estimates, write-backs and events have room of their
own at the end of the queue, because they are few and the record of what was done to a plant. A file
that turns out to be damaged is set aside, and a new one begun; so it is when the file is found to
be gone, and what was written last is written again.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future

import structlog
from sqlalchemy import Engine
from sqlalchemy.exc import SQLAlchemyError

from fieldlink.once_a_minute import OnceAMinute
from fieldlink.store.damage import is_corruption, set_aside
from fieldlink.store.database import cause_of, file_of, open_for_writing
from fieldlink.store.errors import StoreCorruptError, StoreError, StoreMismatchError
from fieldlink.store.file_presence import Presence
from fieldlink.store.housekeeping import Housekeeping, Retention
from fieldlink.store.inserting import insert_batch, may_pass
from fieldlink.store.records import EventRecord, Record, SampleRecord
from fieldlink.store.settings_and_counts import HistorianSettings, StoreReport
from fieldlink.store.wal import keep_damaged_log

__all__ = ["Historian"]

_log = structlog.get_logger(__name__)

TIDY_TIME = 0.1
"""Seconds that housekeeping may take between two batches."""


class Historian:
    """Writes records to a database from a thread of its own.

    Args:
        url: SQLAlchemy address.
        settings: sizes and patience.
        retention: what is kept and for how long; everything for ever unless given.
    """

    def __init__(
        self,
        url: str,
        settings: HistorianSettings | None = None,
        *,
        retention: Retention | None = None,
    ) -> None:
        self._url = url
        self._housekeeping = Housekeeping(retention or Retention())
        self._sweep: Iterator[int] | None = None
        self._sweep_due = threading.Event()
        self._settings = settings or HistorianSettings()
        self._queue: queue.SimpleQueue[Record] = queue.SimpleQueue()
        self._samples_stop_at = int(0.9 * self._settings.queue)
        self._lock = threading.Lock()
        self._written = self._dropped = self._retries = self._in_hand = 0
        self._set_aside = self._removed = self._gone = 0
        self._presence: Presence | None = None
        self._receipts: dict[int, Future[bool]] = {}
        self._last_error = ""
        self._failing = False
        self._refusals = OnceAMinute()
        self._mismatch_since: float | None = None
        self._overflowing_since: int | None = None
        self._stopping = threading.Event()
        self._deadline = float("inf")
        self._thread: threading.Thread | None = None

    def start(self, opened: EventRecord) -> None:
        """Open the database, store ``opened`` in it, and begin to write.

        A damaged file is set aside and a new one begun; that is an event in the new one.

        Raises:
            StoreError: see `open_for_writing`.
        """
        try:
            engine = self._open(opened)
        except StoreCorruptError as error:
            engine = self._begin_anew(str(error.__cause__), opened)
        self._written += 1
        self._thread = threading.Thread(
            target=self._run, args=(engine,), name="historian", daemon=True
        )
        self._thread.start()

    def put(self, record: Record, *, wait: bool = False) -> bool:
        """Hand over a record; returns at once, False when there was no room for it.

        With ``wait`` it waits for room instead, for runs that are faster than any disk.
        """
        room_for = (
            self._samples_stop_at if isinstance(record, SampleRecord) else self._settings.queue
        )
        while wait and self._queue.qsize() >= room_for:
            time.sleep(0.001)
        if self._queue.qsize() >= room_for:
            self._drop(1)
            if self._overflowing_since is None:
                self._overflowing_since = self._dropped - 1
                _log.error("store.overflow", waiting=self._queue.qsize(), error=self._last_error)
            return False
        self._queue.put(record)
        since = self._overflowing_since
        if since is not None and self._queue.qsize() < 0.5 * self._samples_stop_at:
            self._overflowing_since = None
            self._note_loss(self._dropped - since)
        return True

    def keep(self, record: Record) -> Future[bool]:
        """Hand over a record; the promise becomes True when it is stored, False when it is lost."""
        receipt: Future[bool] = Future()
        self._receipts[id(record)] = receipt
        if not self.put(record):
            self._settle([record], stored=False)
        return receipt

    def tidy(self) -> None:
        """Let the retention be applied soon, between two batches; returns at once."""
        self._sweep_due.set()

    @property
    def alive(self) -> bool:
        """Whether the writing thread runs, as it must from `start` to `stop`."""
        return self._thread is not None and self._thread.is_alive()

    def report(self) -> StoreReport:
        """Return the counts up to now."""
        with self._lock:
            return StoreReport(
                self._written,
                self._dropped,
                self._queue.qsize() + self._in_hand,
                self._retries,
                self._last_error,
                self._failing,
                self._set_aside,
                self._removed,
                self._gone,
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
            while True:
                batch = self._next_batch()
                if batch:
                    engine = self._write(engine, batch)
                elif self._stopping.is_set():
                    return
                engine = self._tidy(engine)
        finally:
            engine.dispose()

    def _next_batch(self) -> list[Record]:
        """Wait for records; empty when none came for a while, or when stopping and none is left."""
        batch: list[Record] = []
        try:
            batch.append(self._queue.get(timeout=self._settings.linger))
        except queue.Empty:
            return batch
        with self._lock:
            self._in_hand = 1
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

    def _write(self, engine: Engine, batch: Sequence[Record]) -> Engine:
        """Write a batch, however long that takes; return the engine to go on with."""
        failed = False
        while True:
            try:
                if self._presence is not None and (what := self._presence.lost()):
                    engine = self._go_on_without(engine, self._presence, what)
                written = insert_batch(engine, batch)
                if self._presence is not None and self._presence.lost():
                    # It went into a file that nobody will find.
                    continue
            except StoreError as error:
                if isinstance(error, StoreMismatchError) and self._is_beyond_patience():
                    self._refuse(batch, str(error), failing=True)
                    break
                self._note_failure(str(error), first=not failed)
                failed = True
                if self._give_up(batch):
                    break
                continue
            except SQLAlchemyError as error:
                if is_corruption(error) and (anew := self._replace(engine, error)) is not None:
                    engine = anew
                    continue
                if not may_pass(error):
                    # Not the database but a record is wrong: the others must not suffer.
                    engine = self._write_singly(engine, batch, cause_of(error))
                    break
                self._note_failure(cause_of(error), first=not failed)
                failed = True
                if self._give_up(batch):
                    break
                continue
            except Exception as error:  # noqa: BLE001  (of a driver, for a value out of its range)
                engine = self._write_singly(engine, batch, " ".join(str(error).split()))
                break
            self._mismatch_since = None
            with self._lock:
                self._written += written
                self._failing = False
            self._settle(batch, stored=True)
            if failed:
                _log.info("store.writable_again", retries=self._retries)
            break
        with self._lock:
            self._in_hand = 0
        return engine

    def _write_singly(self, engine: Engine, batch: Sequence[Record], cause: str) -> Engine:
        """Write the good rows of a batch that is refused as a whole."""
        if len(batch) == 1:
            self._refuse(batch, f"a row of {batch[0].table.name} is refused: {cause}")
            return engine
        for record in batch:
            engine = self._write(engine, [record])
        return engine

    def _refuse(self, batch: Sequence[Record], cause: str, *, failing: bool = False) -> None:
        """Give up records that the database will never take; each cause is told once a minute."""
        self._drop(len(batch))
        self._settle(batch, stored=False)
        with self._lock:
            self._last_error = cause
            self._failing = failing
        if lost := self._refusals.note(cause, len(batch)):
            _log.error("store.refused", error=cause, records=lost)
            if not failing and not isinstance(batch[0], EventRecord):
                message = f"lost {lost} records: {cause}"
                self.put(EventRecord(_now_ms(), "store.refused", "store", message))

    def _is_beyond_patience(self) -> bool:
        """Whether a database that is no historian has had the place of ours for too long."""
        now = time.monotonic()
        if self._mismatch_since is None:
            self._mismatch_since = now
        return now - self._mismatch_since >= self._settings.patience

    def _give_up(self, batch: Sequence[Record]) -> bool:
        """Wait for the next attempt; True when there is no time left for one."""
        if time.monotonic() >= self._deadline:
            self._drop(len(batch))
            self._settle(batch, stored=False)
            return True
        if self._stopping.is_set():
            time.sleep(min(self._settings.retry, 0.05))
        else:
            self._stopping.wait(self._settings.retry)
        return False

    def _tidy(self, engine: Engine) -> Engine:
        """Go on with the sweep that is under way, for a moment; begin one when it is due."""
        if self._sweep is None and self._sweep_due.is_set():
            self._sweep_due.clear()
            self._sweep = self._housekeeping.sweep(engine)
        if self._sweep is None:
            return engine
        until = time.monotonic() + TIDY_TIME
        try:
            while time.monotonic() < until:
                removed = next(self._sweep, None)
                if removed is None:
                    self._sweep = None
                    break
                with self._lock:
                    self._removed += removed
        except SQLAlchemyError as error:
            # The next sweep begins where this one ended.
            self._sweep = None
            self._note_failure(cause_of(error), first=True)
            if is_corruption(error):
                return self._replace(engine, error) or engine
            with self._lock:
                self._failing = False
        except Exception as error:  # noqa: BLE001  (told; samples go on being stored)
            self._sweep = None
            self._note_failure(" ".join(str(error).split()), first=True)
            with self._lock:
                self._failing = False
        return engine

    def _replace(self, engine: Engine, error: SQLAlchemyError) -> Engine | None:
        """Go on with a new file in place of a damaged one; None when that cannot be done now."""
        engine.dispose()
        self._sweep = None
        cause = cause_of(error)
        opened = EventRecord(_now_ms(), "store.reopened", "store", "after damage")
        try:
            return self._begin_anew(cause, opened)
        except StoreError as problem:
            with self._lock:
                self._last_error = str(problem)
            _log.error("store.cannot_be_replaced", error=str(problem))
            return None

    def _open(self, opened: EventRecord) -> Engine:
        file = file_of(self._url)
        damage = "" if file is None else keep_damaged_log(file)
        engine = open_for_writing(self._url, opened, self._settings.busy_timeout)
        self._presence = None if file is None else Presence(file)
        if damage:
            _log.error("store.log_damaged", error=damage)
            self.put(EventRecord(_now_ms(), "store.log_damaged", "store", damage))
        return engine

    def _go_on_without(self, engine: Engine, presence: Presence, what: str) -> Engine:
        """Open what is there under the file's name now, or begin a new one."""
        self._sweep = None
        presence.let_go(engine)
        file = file_of(self._url)
        message = (
            f"{file} {what} while it was written; what was in it is where it is now, and the "
            "historian goes on here"
        )
        opened = EventRecord(_now_ms(), "store.gone", "store", message)
        try:
            anew = self._open(opened)
        except StoreCorruptError as error:
            anew = self._begin_anew(str(error.__cause__), opened)
        with self._lock:
            self._gone += 1
            self._written += 1
        _log.error("store.gone", file=str(file), what=what)
        return anew

    def _begin_anew(self, cause: str, opened: EventRecord) -> Engine:
        file = file_of(self._url)
        assert file is not None
        aside = set_aside(file)
        message = (
            f"{file.name} is damaged ({cause}) and was set aside as {aside.name}; a new historian "
            "has begun. sqlite3's .recover may save what is in the old one"
        )
        engine = self._open(opened)
        with self._lock:
            self._set_aside += 1
            self._last_error = cause
        _log.error("store.set_aside", file=str(file), aside=str(aside), cause=cause)
        self.put(EventRecord(_now_ms(), "store.set_aside", "store", message))
        return engine

    def _note_failure(self, cause: str, *, first: bool) -> None:
        with self._lock:
            self._retries += 1
            self._last_error = cause
            self._failing = True
        if first:
            _log.error("store.cannot_write", error=cause, waiting=self._queue.qsize())

    def _note_loss(self, lost: int) -> None:
        """Say in the store itself how much is missing from it."""
        message = f"{lost} records were lost while the store could not be written"
        _log.error("store.overflow_over", lost=lost, error=self._last_error)
        self.put(EventRecord(_now_ms(), "store.lost", "store", f"{message}: {self._last_error}"))

    def _settle(self, batch: Sequence[Record], *, stored: bool) -> None:
        """Keep the promises made for records; identity tells them, their batch holds them."""
        if not self._receipts:
            return
        for record in batch:
            receipt = self._receipts.pop(id(record), None)
            if receipt is not None:
                receipt.set_result(stored)

    def _drop(self, count: int) -> None:
        with self._lock:
            self._dropped += count


def _now_ms() -> int:
    return round(1000.0 * time.time())
