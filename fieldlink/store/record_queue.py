"""The bounded queue between the daemon and the historian's thread, and the promises made for rows.

Estimates, write-backs and events have room of their own at its end, because they are few and the
record of what was done to a plant; samples may fill nine tenths of it.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Sequence
from concurrent.futures import Future

import structlog

from fieldlink.store.records import EventRecord, Record, SampleRecord
from fieldlink.store.running_counts import RunningCounts

__all__ = ["RecordQueue", "now_ms"]

_log = structlog.get_logger(__name__)

SAMPLES_SHARE = 0.9
"""Share of the queue that samples may fill."""


class RecordQueue:
    """Takes records from any thread; one thread takes them out in batches.

    Args:
        size: records that may wait.
        counts: gets what is dropped.
    """

    def __init__(self, size: int, counts: RunningCounts) -> None:
        self._size = size
        self._samples_stop_at = int(SAMPLES_SHARE * size)
        self._counts = counts
        self._queue: queue.SimpleQueue[Record] = queue.SimpleQueue()
        self._receipts: dict[int, Future[bool]] = {}
        self._overflowing_since: int | None = None

    def __len__(self) -> int:
        """Return how many records wait."""
        return self._queue.qsize()

    def put(self, record: Record, *, wait: bool = False) -> bool:
        """Take a record; returns at once, False when there was no room for it.

        With ``wait`` it waits for room instead, for runs that are faster than any disk.
        """
        room_for = self._samples_stop_at if isinstance(record, SampleRecord) else self._size
        # Not by `len`, which is a call more for every sample.
        waiting = self._queue.qsize
        while wait and waiting() >= room_for:
            time.sleep(0.001)
        if waiting() >= room_for:
            self._counts.add(dropped=1)
            if self._overflowing_since is None:
                self._overflowing_since = self._counts.dropped - 1
                _log.error("store.overflow", waiting=waiting(), error=self._counts.last_error)
            return False
        self._queue.put(record)
        since = self._overflowing_since
        if since is not None and waiting() < 0.5 * self._samples_stop_at:
            self._overflowing_since = None
            self._note_loss(self._counts.dropped - since)
        return True

    def keep(self, record: Record) -> Future[bool]:
        """Take a record; the promise becomes True when it is stored, False when it is lost."""
        receipt: Future[bool] = Future()
        self._receipts[id(record)] = receipt
        if not self.put(record):
            self.settle([record], stored=False)
        return receipt

    def first(self, patience: float) -> Record | None:
        """Take the oldest record out; None when none came within so many seconds."""
        try:
            return self._queue.get(timeout=patience)
        except queue.Empty:
            return None

    def more(self, count: int) -> list[Record]:
        """Take out what waits, at most so many records, without waiting."""
        taken: list[Record] = []
        while len(taken) < count:
            try:
                taken.append(self._queue.get_nowait())
            except queue.Empty:
                break
        return taken

    def settle(self, batch: Sequence[Record], *, stored: bool) -> None:
        """Report to those who wait for a record of the batch whether it was stored."""
        if not self._receipts:
            return
        for record in batch:
            receipt = self._receipts.pop(id(record), None)
            if receipt is not None:
                receipt.set_result(stored)

    def drop(self, batch: Sequence[Record]) -> None:
        """Give up records that were taken out: count them as lost."""
        self._counts.add(dropped=len(batch))
        self.settle(batch, stored=False)

    def _note_loss(self, lost: int) -> None:
        """Say in the store itself how much is missing from it."""
        cause = self._counts.last_error
        message = f"{lost} records were lost while the store could not be written"
        _log.error("store.overflow_over", lost=lost, error=cause)
        self.put(EventRecord(now_ms(), "store.lost", "store", f"{message}: {cause}"))


def now_ms() -> int:
    """Return the time as milliseconds since 1970, as records carry it."""
    return round(1000.0 * time.time())
