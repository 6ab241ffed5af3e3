"""What the store knows of every loop: read in full once, after that only rows that are new."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial

import structlog

from fieldlink.store import StoreError
from fieldlink.store.schema import ESTIMATES, WRITEBACKS
from fieldlink.web.view.store_queries import DAY_MS, Row, StoreQueries

__all__ = ["StoredLoop", "StoredLoops"]

_log = structlog.get_logger(__name__)

SERIES_MS = 400 * DAY_MS
"""How far back the trend looks: a year and the weeks around it."""

BUCKETS = ((DAY_MS, DAY_MS // 24), (21 * DAY_MS, DAY_MS), (SERIES_MS, 7 * DAY_MS))
"""How the trend is thinned: the last estimate of each hour of a day, of each day of three weeks, of
each week before that."""

NEWEST_ROWS = 2000
"""Newest estimates of all loops that are read one by one: all of a small site's last day."""

NEWEST = 40
"""Points of a trend that are younger than a day: half-hourly windows of a shift or two."""

ACCEPTED_MS = 35 * DAY_MS
"""How far back an accepted block is looked for: blocks are valid for a day and renewed before."""


@dataclass(slots=True)
class StoredLoop:
    """What is known of a loop from the store."""

    last: Row | None = None
    judged: Row | None = None
    sticky: Row | None = None
    attempt: Row | None = None
    accepted: Row | None = None
    points: dict[int, Row] = field(default_factory=dict)
    annotated_ms: int | None = None

    @property
    def all_points(self) -> list[Row]:
        """The estimates that make the trend, oldest first, without documents."""
        return [self.points[key] for key in sorted(self.points)]

    @property
    def trend_points(self) -> list[Row]:
        """Those since the last annotation."""
        since = self.annotated_ms or 0
        return [self.points[key] for key in sorted(self.points) if key > since]


class StoredLoops:
    """Keeps what is known of every loop up to date.

    Args:
        queries: the store.
        lock: held while points are added from another thread.

    Attributes:
        lacks_points: whether loops were loaded whose trends have no points yet.
    """

    def __init__(self, queries: StoreQueries, lock: threading.Lock) -> None:
        self._queries = queries
        self._lock = lock
        self._loops: dict[str, StoredLoop] = {}
        self._seen = {"estimates": 0, "writebacks": 0}
        self.lacks_points = False

    def __getitem__(self, name: str) -> StoredLoop:
        """Return what is known of a loop that was loaded."""
        return self._loops[name]

    def get(self, name: str) -> StoredLoop | None:
        """Return what is known of a loop; None when it was not loaded."""
        return self._loops.get(name)

    def unknown(self, names: Iterable[str]) -> list[str]:
        """Return the names that were not loaded."""
        return [name for name in names if name not in self._loops]

    def load(self, names: list[str], now_ms: int) -> None:
        """Read what the store has of loops that are not known yet."""
        if not self._loops:
            self._seen = {
                "estimates": self._queries.newest_id(ESTIMATES),
                "writebacks": self._queries.newest_id(WRITEBACKS),
            }
        for name in names:
            self._loops[name] = StoredLoop()
        last = self._queries.last_estimates(names)
        since_ms = now_ms - ACCEPTED_MS
        for name, row in self._queries.last_accepted(names, since_ms).items():
            self._loops[name].accepted = row
        for name, row in self._queries.estimates_behind(names, since_ms).items():
            self._loops[name].sticky = row
        doubtful = [name for name, row in last.items() if row["verdict"] is None]
        judged = {**last, **self._queries.last_judged(doubtful)}
        for name, row in self._queries.last_attempts(names).items():
            self._loops[name].attempt = row
        for name, row in last.items():
            self._loops[name].last = row
        for name, row in judged.items():
            if row["verdict"] is not None:
                self._loops[name].judged = row
        self.lacks_points = True
        for event in self._queries.events("operator.annotate", now_ms - SERIES_MS, 10_000):
            known = self._loops.get(event["source"])
            if known is not None and known.annotated_ms is None:
                known.annotated_ms = event["utc_ms"]

    def read_points(self, now_ms: int) -> None:
        """Read the points of every loop's trend, newest first."""
        try:
            parts = [partial(self._queries.newest_estimates, NEWEST_ROWS)]
            parts += [
                partial(self._queries.thinned_estimates, now_ms - since, bucket)
                for since, bucket in BUCKETS
            ]
            for part in parts:
                rows = part()
                with self._lock:
                    for row in rows:
                        known = self._loops.get(row["loop"])
                        if known is not None and row["verdict"] is not None:
                            known.points[row["window_end_ms"]] = row
        except StoreError as error:
            _log.warning("web.no_trends", error=str(error))

    def read_new(self, now_ms: int) -> None:
        """Read what is new in the store since the last look."""
        for row in self._queries.estimates_after(self._seen["estimates"]):
            self._seen["estimates"] = row["id"]
            known = self._loops.get(row["loop"])
            if known is None:
                continue
            known.last = row
            if row["verdict"] is not None:
                known.judged = row
                self._add_point({key: row[key] for key in row if key != "document"})
        newest = self._queries.newest_id(WRITEBACKS)
        if newest != self._seen["writebacks"]:
            before, self._seen["writebacks"] = self._seen["writebacks"], newest
            for row in self._queries.attempts_after(before):
                known = self._loops.get(row["loop"])
                if known is None:
                    continue
                known.attempt = row
                if row["outcome"] == "accepted":
                    name, since_ms = row["loop"], now_ms - ACCEPTED_MS
                    known.accepted = row
                    known.sticky = self._queries.estimates_behind([name], since_ms).get(name)
        for event in self._queries.events("operator.annotate", now_ms - 60_000, 1000)[::-1]:
            if (known := self._loops.get(event["source"])) is not None:
                known.annotated_ms = event["utc_ms"]

    def _add_point(self, row: Row) -> None:
        known = self._loops.get(row["loop"])
        if known is None or row["verdict"] is None:
            return
        known.points[row["window_end_ms"]] = row
        recent = sorted(known.points)[-2 * NEWEST :]
        if len(recent) == 2 * NEWEST and recent[0] > recent[-1] - DAY_MS:
            # Windows that follow each other within minutes: every second one is enough.
            for key in recent[1:NEWEST:2]:
                del known.points[key]
