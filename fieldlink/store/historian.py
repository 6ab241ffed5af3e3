"""The historian: a thread that writes what the daemon hands it, so that the daemon never waits.

Records go into a bounded queue and reach the database in batches, one transaction each. While the
database cannot be written, the batch is kept and tried again; when the queue is full meanwhile, the
newest samples are dropped, counted and reported. Estimates, write-backs and events have room of
their own at the end of the queue, because they are few and the record of what was done to a plant.
A file that turns out to be damaged is set aside, and a new one begun. When the file is gone, a new
one is begun too, and what was written last is written again.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future

import structlog
from sqlalchemy.exc import SQLAlchemyError

from fieldlink.once_a_minute import OnceAMinute
from fieldlink.store.damage import is_corruption
from fieldlink.store.database import cause_of, shown
from fieldlink.store.errors import StoreError, StoreInUseError, StoreMismatchError
from fieldlink.store.housekeeping import Housekeeping, Retention
from fieldlink.store.inserting import insert_batch, may_pass
from fieldlink.store.open_database import OpenDatabase
from fieldlink.store.record_queue import RecordQueue, now_ms
from fieldlink.store.records import EventRecord, Record
from fieldlink.store.running_counts import RunningCounts
from fieldlink.store.settings_and_counts import HistorianSettings, StoreReport
from fieldlink.store.writers import Claim, Writer

__all__ = ["Historian"]

_log = structlog.get_logger(__name__)

LOOK = 1 / 60
"""Share of the time after which a silent writer counts as dead, between two looks at it."""

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
        self._settings = settings or HistorianSettings()
        self._counts = RunningCounts()
        self._records = RecordQueue(self._settings.queue, self._counts)
        self._database = OpenDatabase(url, self._settings.busy_timeout, self._records, self._counts)
        self._housekeeping = Housekeeping(retention or Retention())
        self._sweep: Iterator[int] | None = None
        self._sweep_due = threading.Event()
        self._refusals = OnceAMinute()
        self._mismatch_since: float | None = None
        self._stopping = threading.Event()
        self._deadline = float("inf")
        self._thread: threading.Thread | None = None

    def start(self, opened: EventRecord, writer: Writer | None = None) -> None:
        """Open the database, store ``opened`` in it, and begin to write.

        A damaged file is set aside and a new one begun; that is an event in the new one. Where
        another writer of the loops may have been killed, this waits until that is known.

        Args:
            opened: the first record.
            writer: who writes, so that no loop has two writers; anybody may write unless given.

        Raises:
            StoreInUseError: another daemon writes one of the loops.
            StoreError: see `open_for_writing`.
        """
        if writer is not None:
            where = shown(self._url)
            self._database.claim = Claim(writer, self._settings.expires, where)
        self._open(opened)
        self._thread = threading.Thread(target=self._run, name="historian", daemon=True)
        self._thread.start()

    def _open(self, opened: EventRecord) -> None:
        waiting = False
        while True:
            try:
                self._database.open(opened)
            except StoreInUseError as error:
                if error.alive:
                    raise
                if not waiting:
                    seconds = self._settings.expires
                    _log.warning("store.waiting_for_writer", seconds=seconds, error=str(error))
                waiting = True
                time.sleep(LOOK * self._settings.expires)
            else:
                return

    def follow(self, loops: Iterable[str]) -> None:
        """Write other loops from now on."""
        if self._database.claim is not None:
            self._database.claim.follow(loops)

    def put(self, record: Record, *, wait: bool = False) -> bool:
        """Hand over a record; see `RecordQueue.put`."""
        return self._records.put(record, wait=wait)

    def keep(self, record: Record) -> Future[bool]:
        """Hand over a record; the promise becomes True when it is stored, False when it is lost."""
        return self._records.keep(record)

    def tidy(self) -> None:
        """Let the retention be applied soon, between two batches; returns at once."""
        self._sweep_due.set()

    @property
    def alive(self) -> bool:
        """Whether the writing thread runs, as it must from `start` to `stop`."""
        return self._thread is not None and self._thread.is_alive()

    def report(self) -> StoreReport:
        """Return the counts up to now."""
        return self._counts.report(len(self._records))

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

    def _run(self) -> None:
        try:
            self._begin_housekeeping()
            while True:
                # Asked first: what was put before `stop` is in the queue then.
                stopping = self._stopping.is_set()
                batch = self._next_batch()
                if batch:
                    self._write(batch)
                elif stopping:
                    return
                elif self._is_to_beat():
                    self._write([])
                self._tidy()
        finally:
            self._database.close()

    def _is_to_beat(self) -> bool:
        claim = self._database.claim
        return claim is not None and claim.is_due(self._settings.beat)

    def _next_batch(self) -> list[Record]:
        """Wait for records; empty when none came for a while, or when stopping and none is left."""
        record = self._records.first(self._settings.linger)
        if record is None:
            return []
        self._counts.hold(1)
        if not self._stopping.is_set():
            self._stopping.wait(self._settings.linger)
        batch = [record, *self._records.more(self._settings.batch - 1)]
        self._counts.hold(len(batch))
        return batch

    def _write(self, batch: Sequence[Record]) -> None:
        """Write a batch, however long that takes."""
        failure: EventRecord | None = None
        while True:
            try:
                if self._database.is_lost():
                    self._sweep = None
                    self._database.find_again()
                rows = [*batch, *_outage(failure)]
                written = insert_batch(self._database.engine, rows, self._database.claim)
                if self._database.is_lost():
                    # It went into a file that has no name any more.
                    continue
            except StoreError as error:
                if isinstance(error, StoreMismatchError) and self._is_beyond_patience():
                    self._refuse(batch, str(error), failing=True)
                    break
                failure = self._note_failure(str(error), failure)
                if self._give_up(batch):
                    break
                continue
            except SQLAlchemyError as error:
                if is_corruption(error) and self._replace(error):
                    continue
                if not may_pass(error):
                    # Not the database but a record is wrong: the others must not suffer.
                    self._write_singly(batch, cause_of(error))
                    break
                failure = self._note_failure(cause_of(error), failure)
                if self._give_up(batch):
                    break
                continue
            except Exception as error:  # noqa: BLE001  (of a driver, for a value out of its range)
                self._write_singly(batch, " ".join(str(error).split()))
                break
            self._mismatch_since = None
            self._counts.succeed(written)
            self._records.settle(batch, stored=True)
            if failure is not None:
                _log.info("store.writable_again", retries=self._counts.retries)
            break
        self._counts.hold(0)

    def _write_singly(self, batch: Sequence[Record], cause: str) -> None:
        """Write the good rows of a batch that is refused as a whole."""
        if len(batch) == 1:
            self._refuse(batch, f"a row of {batch[0].table.name} is refused: {cause}")
            return
        for record in batch:
            self._write([record])

    def _refuse(self, batch: Sequence[Record], cause: str, *, failing: bool = False) -> None:
        """Give up records that the database will never take; each cause is logged once a minute."""
        self._records.drop(batch)
        self._counts.fail(cause, failing=failing)
        if lost := self._refusals.note(cause, len(batch)):
            _log.error("store.refused", error=cause, records=lost)
            if not failing and not isinstance(batch[0], EventRecord):
                message = f"lost {lost} records: {cause}"
                self.put(EventRecord(now_ms(), "store.refused", "store", message))

    def _is_beyond_patience(self) -> bool:
        """Whether a foreign database has been at the historian's address for too long."""
        now = time.monotonic()
        if self._mismatch_since is None:
            self._mismatch_since = now
        return now - self._mismatch_since >= self._settings.patience

    def _give_up(self, batch: Sequence[Record]) -> bool:
        """Wait for the next attempt; True when there is no time left for one."""
        if time.monotonic() >= self._deadline:
            self._records.drop(batch)
            return True
        if self._stopping.is_set():
            time.sleep(min(self._settings.retry, 0.05))
        else:
            self._stopping.wait(self._settings.retry)
        return False

    def _tidy(self) -> None:
        """Go on with the sweep that is under way, for a moment; begin one when it is due."""
        if self._sweep is None and self._sweep_due.is_set():
            self._sweep_due.clear()
            self._sweep = self._housekeeping.sweep(self._database.engine)
        if self._sweep is None:
            return
        until = time.monotonic() + TIDY_TIME
        try:
            while time.monotonic() < until:
                removed = next(self._sweep, None)
                if removed is None:
                    self._sweep = None
                    break
                self._counts.add(removed=removed)
        except SQLAlchemyError as error:
            # The next sweep begins where this one ended.
            self._end_sweep(error)
        except Exception as error:  # noqa: BLE001  (logged; samples go on being stored)
            self._sweep = None
            self._note_failure(" ".join(str(error).split()), None)
            self._counts.recover()

    def _begin_housekeeping(self) -> None:
        try:
            self._housekeeping.begin(self._database.engine)
        except SQLAlchemyError as error:
            self._end_sweep(error)

    def _end_sweep(self, error: SQLAlchemyError) -> None:
        self._sweep = None
        self._note_failure(cause_of(error), None)
        if is_corruption(error):
            self._replace(error)
            return
        self._counts.recover()

    def _replace(self, error: SQLAlchemyError) -> bool:
        self._sweep = None
        return self._database.replace(cause_of(error))

    def _note_failure(self, cause: str, before: EventRecord | None) -> EventRecord:
        """Count a failure; return the event of the first one in a row, to be stored later."""
        self._counts.retry(cause)
        if before is not None:
            return before
        message = (
            f"{shown(self._url)}: {cause}; look at its disk or server: records wait, and what may "
            "not be lost, such as blocks, is not written to a PLC before"
        )
        _log.error("store.cannot_write", error=message, waiting=len(self._records))
        return EventRecord(now_ms(), "store.cannot_write", "store", message)


def _outage(failure: EventRecord | None) -> list[Record]:
    """Return the events of an outage that is over with the transaction that stores them."""
    if failure is None:
        return []
    now = now_ms()
    message = f"records waited for {max(0.0, (now - failure.utc_ms) / 1000.0):.1f} s"
    return [failure, EventRecord(now, "store.writable_again", "store", message)]
