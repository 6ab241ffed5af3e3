"""Every loop in one table: what the store knows of it, with what the running daemon adds.

The store is read in full once; after that only rows that are new. One refresh a second serves
however many browsers look.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from fieldlink.daemon import DaemonStatus, LoopStatus
from fieldlink.site import Site
from fieldlink.web.analyst import Analyst, Course, Point
from fieldlink.web.view.block_state import block_document
from fieldlink.web.view.causes import Causes, cause_document
from fieldlink.web.view.loop_state import device_of, device_state_of, quality_of
from fieldlink.web.view.store_queries import Row, StoreQueries
from fieldlink.web.view.stored_loops import StoredLoop, StoredLoops
from fieldlink.web.view.texts import iso_time, verdict_of

__all__ = ["Document", "Fleet", "FleetView"]

Document = dict[str, Any]

USUAL_OP_SPAN = 100.0
"""OP's span where the register map does not give it, as in the work list."""

REFRESH_EVERY = 1.0
"""Seconds for which a view of the fleet serves everybody who asks."""

REVISIONS_A_SECOND = 100
"""Far more than refreshes make: the first revision of a view is above all of those before it."""


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
        self._known = StoredLoops(queries, self._lock)
        self._courses: dict[str, str] = {}
        self._causes = Causes(queries)
        self._diagnoses: Mapping[str, Row] = {}
        # A page that is open while the daemon or its store is replaced knows an older number.
        self._revision = round(REVISIONS_A_SECOND * time.time())
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
        """Read what the store has of every loop, before the first request.

        Raises:
            StoreError: the store cannot be read.
        """
        with self._lock:
            names = self._known.unknown(self._names(self._site()))
            if names:
                self._known.load(names, round(time.time() * 1000.0))

    def close(self) -> None:
        """Wait for what is being read."""
        if self._reader is not None:
            self._reader.join()

    def points_of(self, loop: str) -> list[Row]:
        """Return the estimates that make a loop's trend, oldest first, without documents."""
        known = self._known.get(loop)
        return [] if known is None else known.all_points

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
        points = known.trend_points
        return points, self._course(loop, known, known.sticky or known.judged)

    def _refresh(self, status: DaemonStatus | None) -> Fleet:
        now_ms = round(time.time() * 1000.0)
        site = self._site()
        names = self._names(site)
        fresh = self._known.unknown(names)
        if fresh:
            self._known.load(fresh, now_ms)
        self._known.read_new(now_ms)
        if self._known.lacks_points and self._fleet is not None:
            # Points of trends are many: they come after the first view, not before it.
            self._known.lacks_points = False
            self._reader = threading.Thread(
                target=self._known.read_points, args=(now_ms,), name="trend points", daemon=True
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

    def _course(self, name: str, known: StoredLoop, judged: Row | None) -> Course | None:
        if judged is None or judged["verdict"] != "stiction":
            return None
        points = known.trend_points
        if len(points) < 3:
            return None
        limit = self._limit(name)
        key = f"{name}\0{points[0]['id']}\0{points[-1]['id']}\0{limit}"
        if (before := self._courses.get(name)) not in (None, key):
            # What is there stays until the new one is ready, so that the table does not blink.
            fresh = self._analyst.course(key, lambda: _points(points), limit)
            if fresh is None:
                assert before is not None
                return self._analyst.course(before, list, None)
            self._analyst.forget(before or "")
        self._courses[name] = key
        return self._analyst.course(key, lambda: _points(points), limit)

    def _limit(self, name: str) -> float | None:
        """The work list's limit of S (``report.stick_band_limit``) in units of OP."""
        site = self._site()
        if site is None or name not in site.loops:
            return None
        return 0.01 * site.report.stick_band_limit * (site.op_span(name) or USUAL_OP_SPAN)

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
        # The controller works against the valve, whose effect may be larger than what PV shows.
        avoidable = None if effect is None else min(1.0, max(0.0, effect))
        device = device_of(name, site, live)
        days = None if course is None else course.days_to_limit[0]
        return {
            "name": name,
            "device": device,
            "verdict": verdict,
            "uncertain": bool(document.get("uncertain")),
            "compensated": _compensates(known, live),
            "order": looks.order,
            "urgency": _urgency(avoidable, stick_band["value"], limit),
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
            "avoidable": avoidable,
            "automatic": window.get("automatic"),
            "saturated": window.get("saturated"),
            "travel_per_day": window.get("travel_per_day"),
            "reversals_per_day": window.get("reversals_per_day"),
            "quality": quality_of(live, slots),
            "device_state": device_state_of(device, status, sample),
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


def _since(known: StoredLoop, judged: Row | None) -> int | None:
    """Return the end of the first of the consecutive windows that agree with the judged one."""
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


def _compensates(known: StoredLoop, live: LoopStatus | None) -> bool:
    """Whether the PLC's controller uses a model of a sticky valve, as far as known."""
    if live is not None and live.in_use is not None:
        return live.in_use
    return known.accepted is not None and known.accepted["status"] == "valid"


def _urgency(avoidable: float | None, stick_band: float | None, limit: float | None) -> float:
    """Share of PV's variance that the valve costs, plus the stick band as a share of its limit."""
    used = 0.0 if stick_band is None or not limit else stick_band / limit
    return (avoidable or 0.0) + used


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


def _message(known: StoredLoop) -> str:
    last = known.last
    return "" if last is None else str(last["message"])
