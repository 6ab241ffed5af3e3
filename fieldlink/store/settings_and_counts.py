"""How a historian is set up, and what it says about itself."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["HistorianSettings", "StoreReport"]


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
        patience: seconds that records wait while another program's database is in the place of
            ours, so that the change can be undone; then they are lost.
        beat: seconds after which a writer that has nothing to write shows that it is alive.
        expires: seconds without a sign of life after which another writer counts as dead: six
            beats, or five attempts at a locked database.
    """

    queue: int = 200_000
    batch: int = 2_000
    linger: float = 0.2
    retry: float = 1.0
    busy_timeout: float = 5.0
    flush: float = 20.0
    patience: float = 60.0
    beat: float = 5.0
    expires: float = 30.0


@dataclass(frozen=True, slots=True)
class StoreReport:
    """The counts of records so far.

    Attributes:
        written: rows in the database.
        dropped: records lost because the queue was full, a row was refused, or stopping took too
            long.
        waiting: records in the queue.
        retries: attempts that failed and were repeated.
        last_error: the last failure's text, empty when there was none.
        failing: whether the newest attempt to write failed.
        set_aside: damaged files that were replaced.
        gone: times the file was found deleted, moved or replaced.
        removed: rows that the retention removed.
    """

    written: int = 0
    dropped: int = 0
    waiting: int = 0
    retries: int = 0
    last_error: str = ""
    failing: bool = False
    set_aside: int = 0
    removed: int = 0
    gone: int = 0
