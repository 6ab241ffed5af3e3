"""The counts of every loop's slots, written to the store in regular accounts."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from fieldlink.daemon.windows.loop_counts import LoopCounts
from fieldlink.links import Clock
from fieldlink.store import Record, SlotRecord

__all__ = ["ACCOUNT_EVERY", "SlotAccounts"]

ACCOUNT_EVERY = 600.0
"""Wall seconds that an account covers."""


class SlotAccounts:
    """Writes the differences since the last account.

    A gap is known when it ends, so its missed slots belong to the account of that moment.

    Args:
        put: takes records for the store.
        clock: stamps the accounts.
    """

    def __init__(self, put: Callable[[Record], object], clock: Clock) -> None:
        self._put = put
        self._clock = clock
        self._closed_at = clock.monotonic()
        self._before: dict[str, LoopCounts] = {}

    def close(self, counts: Mapping[str, LoopCounts]) -> None:
        """Write an account of every loop in which something has happened."""
        now = self._clock.monotonic()
        seconds, self._closed_at = now - self._closed_at, now
        utc_ms = round(1000.0 * self._clock.utc())
        for loop, after in counts.items():
            before = self._before.get(loop, LoopCounts())
            if after.expected < before.expected:
                # The loop was changed and counts again.
                before = LoopCounts()
            self._before[loop] = after
            if after == before:
                continue
            self._put(
                SlotRecord(
                    loop=loop,
                    utc_ms=utc_ms,
                    seconds=round(seconds, 3),
                    expected=after.expected - before.expected,
                    read=after.read - before.read,
                    late=after.late - before.late,
                    missed=after.missed - before.missed,
                    bad=after.bad - before.bad,
                    duplicates=after.duplicates - before.duplicates,
                    restarts=after.restarts - before.restarts,
                )
            )
