"""Every loop in one table: what the store knows of it, with what the running daemon adds.

The store is read in full once; after that only rows that are new. One refresh a second serves
however many browsers look.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import structlog

from fieldlink.daemon import DaemonStatus, LoopStatus
from fieldlink.site import Site
from fieldlink.store import StoreError
from fieldlink.store.schema import ESTIMATES, WRITEBACKS
from fieldlink.web.analyst import Analyst, Course, Point
from fieldlink.web.view.block_state import block_document
from fieldlink.web.view.causes import Causes, cause_document
from fieldlink.web.view.store_queries import DAY_MS, Row, StoreQueries
from fieldlink.web.view.words import iso_time, verdict_of

__all__ = ["Document", "Fleet", "FleetView"]

_log = structlog.get_logger(__name__)

Document = dict[str, Any]

REFRESH_EVERY = 1.0
"""Seconds for which a view of the fleet serves everybody who asks."""

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

SAME = 1e-5
"""Relative difference of two stick bands that are one: a block holds them as single floats."""

STALE_AFTER_MS = 600_000
"""A store whose newest sample is older than this is not being written."""


@dataclass(slots=True)
class _Known:
    """What is known of a loop from the store."""

    last: Row | None = None
    judged: Row | None = None
    sticky: Row | None = None
    attempt: Row | None = None
    accepted: Row | None = None
    points: dict[int, Row] = field(default_factory=dict)
    annotated_ms: int | None = None


@dataclass(frozen=True, slots=True)
class Fleet:
    """The fleet at one moment.

    Attributes:
        rows: one document a loop, what to repair first at the top.
        revisions: by loop, the revision in which its row last changed.
        revision: the newest.
        status: the running daemon's, None without one.
        time_ms: the moment.
    """

    rows: list[Document]
    revisions: Mapping[str, int]
    revision: int
    status: DaemonStatus | None
    time_ms: int


class FleetView:
    """Keeps the fleet's table up to date.

    Args:
        queries: the store.
        site: gives loops, devices and limits; None where only a store is known.
        analyst: computes trends.
    """

    def __init__(
        self,
        queries: StoreQueries,
        site: Callable[[], Site | None],
        analyst: Analyst,
    ) -> None:
        self._queries = queries
        self._site = site
        self._analyst = analyst
        self._lock = threading.Lock()
        self._reader: threading.Thread | None = None
        self._lacks_points = False
        self._known: dict[str, _Known] = {}
        self._seen = {"estimates": 0, "writebacks": 0}
        self._courses: dict[str, str] = {}
        self._causes = Causes(queries)
        self._diagnoses: Mapping[str, Row] = {}
        self._revision = 0
        self._rows: dict[str, Document] = {}
        self._revisions: dict[str, int] = {}
        self._fleet: Fleet | None = None
        self._due = 0.0

    def look(self, status: DaemonStatus | None) -> Fleet:
        """Return the fleet as of a second ago at most.

        Args:
            status: the running daemon's snapshot; None without a daemon.

        Raises:
            StoreError: the store cannot be read.
        """
        with self._lock:
            if self._fleet is None or time.monotonic() >= self._due:
                self._fleet = self._refresh(status)
                self._due = time.monotonic() + REFRESH_EVERY
            return self._fleet

    def read_ahead(self) -> None:
        """Read what the store has of every loop, before somebody looks.

        Raises:
            StoreError: the store cannot be read.
        """
        with self._lock:
            names = [name for name in self._names(self._site()) if name not in self._known]
            if names:
                self._load(names, round(time.time() * 1000.0))

    def close(self) -> None:
        """Wait for what is being read."""
        if self._reader is not None:
            self._reader.join()

    def points_of(self, loop: str) -> list[Row]:
        """Return the estimates that make a loop's trend, oldest first, without documents."""
        known = self._known.get(loop)
        return [] if known is None else [known.points[key] for key in sorted(known.points)]

    def judged_of(self, loop: str, status: DaemonStatus | None) -> Row | None:
        """Return the estimate that a loop's verdict rests on, None before the first.

        While the PLC's controller uses a model, its windows cannot show the valve: the verdict is
        that of the window from which the model in use comes.
        """
        known = self._known.get(loop)
        if known is None:
            return None
        live = None if status is None else status.loops.get(loop)
        if known.sticky is not None and _compensates(known, live):
            return known.sticky
        return known.judged

    def diagnosis_of(self, loop: str) -> Document | None:
        """Return a loop's newest diagnosis as ``fieldlink diagnose --json`` prints it."""
        row = self._diagnoses.get(loop)
        return None if row is None else row["document"]

    def course_of(self, loop: str) -> tuple[list[Row], Course | None]:
        """Return the points of a loop since its last annotation, and its course through them."""
        known = self._known.get(loop)
        if known is None:
            return [], None
        points = self._trend_points(known)
        return points, self._course(loop, known, known.sticky or known.judged)

    def _refresh(self, status: DaemonStatus | None) -> Fleet:
        now_ms = round(time.time() * 1000.0)
        site = self._site()
        names = self._names(site)
        fresh = [name for name in names if name not in self._known]
        if fresh:
            self._load(fresh, now_ms)
        self._read_new(now_ms)
        if self._lacks_points and self._fleet is not None:
            # Points of trends are many: they come after the first view, not before it.
            self._lacks_points = False
            self._reader = threading.Thread(
                target=self._read_points, args=(now_ms,), name="trend points", daemon=True
            )
            self._reader.start()
        self._diagnoses = self._causes.look(names)
        samples = {} if status is not None else self._queries.last_samples(names)
        slots = {} if status is not None else self._queries.last_slots(names)
        rows = [self._row(name, site, status, samples.get(name), slots.get(name)) for name in names]
        rows.sort(key=lambda row: (row["order"], -row["urgency"], row["name"]))
        for rank, row in enumerate(rows, 1):
            row["rank"] = rank
        self._note_changes(rows)
        return Fleet(rows, dict(self._revisions), self._revision, status, now_ms)

    def _names(self, site: Site | None) -> list[str]:
        return list(site.loops) if site is not None else self._queries.loops()

    def _load(self, names: list[str], now_ms: int) -> None:
        """Read what the store has of loops that are not known yet."""
        if not self._known:
            self._seen = {
                "estimates": self._queries.newest_id(ESTIMATES),
                "writebacks": self._queries.newest_id(WRITEBACKS),
            }
        for name in names:
            self._known[name] = _Known()
        last = self._queries.last_estimates(names)
        recent = WRITEBACKS.c.utc_ms > now_ms - ACCEPTED_MS
        accepted = self._queries.last_of(
            WRITEBACKS, names, WRITEBACKS.c.outcome == "accepted", recent
        )
        for name, row in accepted.items():
            self._known[name].accepted = row
            self._known[name].sticky = self._behind(row)
        doubtful = [name for name, row in last.items() if row["verdict"] is None]
        judged = {**last, **self._queries.last_judged(doubtful)}
        for name, row in self._queries.last_attempts(names).items():
            self._known[name].attempt = row
        for name, row in last.items():
            self._known[name].last = row
        for name, row in judged.items():
            if row["verdict"] is not None:
                self._known[name].judged = row
        self._lacks_points = True
        for event in self._queries.events("operator.annotate", now_ms - SERIES_MS, 10_000):
            known = self._known.get(event["source"])
            if known is not None and known.annotated_ms is None:
                known.annotated_ms = event["utc_ms"]

    def _read_points(self, now_ms: int) -> None:
        """Read the points of every loop's trend, the newest first."""
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
                        known = self._known.get(row["loop"])
                        if known is not None and row["verdict"] is not None:
                            known.points[row["window_end_ms"]] = row
        except StoreError as error:
            _log.warning("web.no_trends", error=str(error))

    def _read_new(self, now_ms: int) -> None:
        for row in self._queries.estimates_after(self._seen["estimates"]):
            self._seen["estimates"] = row["id"]
            known = self._known.get(row["loop"])
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
                known = self._known.get(row["loop"])
                if known is None:
                    continue
                known.attempt = row
                if row["outcome"] == "accepted":
                    known.accepted = row
                    known.sticky = self._behind(row)
        for event in self._queries.events("operator.annotate", now_ms - 60_000, 1000)[::-1]:
            if (known := self._known.get(event["source"])) is not None:
                known.annotated_ms = event["utc_ms"]

    def _behind(self, accepted: Row) -> Row | None:
        """Return the estimate that an accepted block says: a block that is renewed keeps its S."""
        c, S = ESTIMATES.c, accepted["stick_band"]
        if accepted["status"] != "valid" or S is None:
            return None
        same = c.stick_band.between(S * (1.0 - SAME), S * (1.0 + SAME))
        found = self._queries.last_of(ESTIMATES, [accepted["loop"]], c.verdict == "stiction", same)
        return found.get(accepted["loop"])

    def _add_point(self, row: Row) -> None:
        known = self._known.get(row["loop"])
        if known is None or row["verdict"] is None:
            return
        known.points[row["window_end_ms"]] = row
        recent = sorted(known.points)[-2 * NEWEST :]
        if len(recent) == 2 * NEWEST and recent[0] > recent[-1] - DAY_MS:
            # Windows that follow each other within minutes: every second one is enough.
            for key in recent[1:NEWEST:2]:
                del known.points[key]

    def _trend_points(self, known: _Known) -> list[Row]:
        since = known.annotated_ms or 0
        return [known.points[key] for key in sorted(known.points) if key > since]

    def _course(self, name: str, known: _Known, judged: Row | None) -> Course | None:
        if judged is None or judged["verdict"] != "stiction":
            return None
        points = self._trend_points(known)
        if len(points) < 3:
            return None
        key = f"{name}\0{points[0]['id']}\0{points[-1]['id']}"
        if (before := self._courses.get(name)) not in (None, key):
            # What is there stays until the new one is ready, so that the table does not blink.
            fresh = self._analyst.course(key, lambda: _points(points), self._limit(name))
            if fresh is None:
                assert before is not None
                return self._analyst.course(before, list, None)
            self._analyst.forget(before or "")
        self._courses[name] = key
        return self._analyst.course(key, lambda: _points(points), self._limit(name))

    def _limit(self, name: str) -> float | None:
        site = self._site()
        if site is None or name not in site.loops:
            return None
        return site.loops[name].writeback.limits.stick_band[1]

    def _row(
        self,
        name: str,
        site: Site | None,
        status: DaemonStatus | None,
        sample: Row | None,
        slots: Row | None,
    ) -> Document:
        known = self._known[name]
        live = None if status is None else status.loops.get(name)
        judged = self.judged_of(name, status)
        document: Mapping[str, Any] = {} if judged is None else judged["document"] or {}
        newest = known.judged["document"] or {} if known.judged is not None else {}
        window = newest.get("window") or {}
        verdict = None if judged is None else judged["verdict"]
        looks = verdict_of(verdict, uncertain=bool(document.get("uncertain")))
        limit = self._limit(name)
        course = self._course(name, known, judged)
        stick_band = _interval(judged, "stick_band")
        effect = (document.get("evidence") or {}).get("effect") if verdict == "stiction" else None
        device = _device_of(name, site, live)
        days = None if course is None else course.days_to_limit[0]
        return {
            "name": name,
            "device": device,
            "verdict": verdict,
            "uncertain": bool(document.get("uncertain")),
            "compensated": _compensates(known, live),
            "order": looks.order,
            "urgency": _urgency(effect, stick_band["value"], limit),
            "score": None if judged is None else judged["score"],
            "stick_band": stick_band,
            "slip_jump": _interval(judged, "slip_jump"),
            "confidence": None if judged is None else judged["confidence"],
            "limit": limit,
            "trend_per_week": None if course is None else course.trend_per_week[0],
            "trend_low": None if course is None else course.trend_per_week[1],
            "trend_high": None if course is None else course.trend_per_week[2],
            "days_to_limit": days,
            "since": iso_time(_since(known, judged)),
            "annotated": iso_time(known.annotated_ms),
            "swing_period_s": window.get("swing_period_s"),
            "avoidable": None if effect is None else min(1.0, max(0.0, effect)),
            "automatic": window.get("automatic"),
            "saturated": window.get("saturated"),
            "travel_per_day": window.get("travel_per_day"),
            "reversals_per_day": window.get("reversals_per_day"),
            "quality": _quality(live, slots),
            "device_state": _state_of(device, status, sample),
            "block": block_document(live, known.attempt),
            "filled": None if live is None else round(live.filled, 2),
            "estimated": None if judged is None else iso_time(judged["window_end_ms"]),
            "message": _message(known),
            **cause_document(self._diagnoses.get(name)),
        }

    def _note_changes(self, rows: list[Document]) -> None:
        changed = [row for row in rows if self._rows.get(row["name"]) != row]
        if changed or len(rows) != len(self._rows):
            self._revision += 1
        for row in changed:
            self._revisions[row["name"]] = self._revision
        self._rows = {row["name"]: row for row in rows}
        self._revisions = {row["name"]: self._revisions[row["name"]] for row in rows}


def _since(known: _Known, judged: Row | None) -> int | None:
    """End of the first window of the run of windows with the verdict, up to the judged one."""
    begin: int | None = None
    if judged is None:
        return None
    for key in sorted(known.points, reverse=True):
        if key > judged["window_end_ms"]:
            continue
        if known.points[key]["verdict"] != judged["verdict"]:
            break
        begin = key
    return begin


def _compensates(known: _Known, live: LoopStatus | None) -> bool:
    """Whether the PLC's controller uses a model of a sticky valve, as far as known."""
    if live is not None and live.in_use is not None:
        return live.in_use
    return known.accepted is not None and known.accepted["status"] == "valid"


def _urgency(effect: float | None, stick_band: float | None, limit: float | None) -> float:
    """Share of PV's variance that the valve costs, plus the stick band as a share of its limit."""
    used = 0.0 if stick_band is None or not limit else stick_band / limit
    return (effect or 0.0) + used


def _interval(row: Row | None, name: str) -> dict[str, float | None]:
    if row is None:
        return {"value": None, "low": None, "high": None}
    return {"value": row[name], "low": row[f"{name}_low"], "high": row[f"{name}_high"]}


def _points(rows: list[Row]) -> list[Point]:
    def number(value: float | None) -> float:
        return math.nan if value is None else value

    names = ("stick_band", "stick_band_low", "stick_band_high")
    jumps = ("slip_jump", "slip_jump_low", "slip_jump_high")
    made: list[Point] = []
    for row in rows:
        S, J = ([number(row[name]) for name in three] for three in (names, jumps))
        if row["verdict"] != "stiction":
            # A healthy window may be one under compensation: neither tells how much it sticks.
            S, J = [math.nan] * 3, [math.nan] * 3
        made.append((row["window_end_ms"] / 1000.0, S[0], S[1], S[2], J[0], J[1], J[2]))
    return made


def _device_of(name: str, site: Site | None, live: LoopStatus | None) -> str:
    if live is not None:
        return live.device
    return site.loops[name].device if site is not None and name in site.loops else ""


def _state_of(device: str, status: DaemonStatus | None, sample: Row | None) -> str:
    if status is not None:
        found = status.devices.get(device)
        return "unknown" if found is None else found.state.name.lower()
    if sample is None:
        return "unknown"
    stale = time.time() * 1000.0 - sample["utc_ms"] > STALE_AFTER_MS
    return "silent" if stale else "recorded"


def _quality(live: LoopStatus | None, slots: Row | None) -> float | None:
    """Share of the slots that were read with good values."""
    if live is not None:
        return round(live.counts.read / live.counts.expected, 3) if live.counts.expected else None
    if slots is None or not slots["expected"]:
        return None
    return float(slots["read"] / slots["expected"])


def _message(known: _Known) -> str:
    last = known.last
    return "" if last is None else str(last["message"])
