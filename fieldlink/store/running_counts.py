"""Counts of a historian at work, kept together because several threads read and change them."""

from __future__ import annotations

import threading

from fieldlink.store.settings_and_counts import StoreReport

__all__ = ["RunningCounts"]


class RunningCounts:
    """Counts of the records so far; see `StoreReport` for the meaning of each count."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._written = self._dropped = self._retries = self._in_hand = 0
        self._set_aside = self._removed = self._gone = 0
        self._last_error = ""
        self._failing = False

    @property
    def dropped(self) -> int:
        """Records lost so far."""
        return self._dropped

    @property
    def retries(self) -> int:
        """Attempts that failed and were repeated."""
        return self._retries

    @property
    def last_error(self) -> str:
        """The last failure's text; empty when there was none."""
        return self._last_error

    def add(
        self, *, written: int = 0, dropped: int = 0, removed: int = 0, set_aside: int = 0,
        gone: int = 0,
    ) -> None:  # fmt: skip
        """Count on."""
        with self._lock:
            self._written += written
            self._dropped += dropped
            self._removed += removed
            self._set_aside += set_aside
            self._gone += gone

    def hold(self, records: int) -> None:
        """Note how many records have left the queue and are not settled."""
        with self._lock:
            self._in_hand = records

    def succeed(self, written: int) -> None:
        """Note an attempt that wrote so many rows."""
        with self._lock:
            self._written += written
            self._failing = False

    def fail(self, cause: str, *, failing: bool = True) -> None:
        """Note why something was not written, and whether the store as a whole is failing."""
        with self._lock:
            self._last_error = cause
            self._failing = failing

    def retry(self, cause: str) -> None:
        """Note an attempt that failed and will be repeated."""
        with self._lock:
            self._retries += 1
            self._last_error = cause
            self._failing = True

    def recover(self) -> None:
        """Note that the last failure was not one of writing."""
        with self._lock:
            self._failing = False

    def mention(self, cause: str) -> None:
        """Note a failure's text."""
        with self._lock:
            self._last_error = cause

    def report(self, queued: int) -> StoreReport:
        """Return the counts; ``queued`` records wait in the queue."""
        with self._lock:
            return StoreReport(
                written=self._written,
                dropped=self._dropped,
                waiting=queued + self._in_hand,
                retries=self._retries,
                last_error=self._last_error,
                failing=self._failing,
                set_aside=self._set_aside,
                removed=self._removed,
                gone=self._gone,
            )
