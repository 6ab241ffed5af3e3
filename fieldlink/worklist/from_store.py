"""The work list of a fleet from its historian: the newest finding, its history, repairs and work.

loops = list_loops(url, site)
rows = sorted(loops, key=lambda loop: loop.row.urgency)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from estimator import Interval, Track
from fieldlink.store import REPAIR_KINDS, FleetReader
from fieldlink.worklist.diagnosed import finding_of_stored, findings_by_loop, remarks_of
from fieldlink.worklist.estimates_over_time import (
    Course,
    Repair,
    outlook_of,
    repair_in,
    trend_of,
    worse_since,
)
from fieldlink.worklist.finding import Cause, Finding, Wrong, finding_of_estimate
from fieldlink.worklist.row import BeforeAfter, Confidence, Figures, WorkItem, WorkRow
from fieldlink.worklist.settings import WorkListSettings
from fieldlink.worklist.window_samples import WindowSamples, figures_of, interval_of

if TYPE_CHECKING:
    import pandas as pd

    from fieldlink.site import Site

__all__ = ["Diagnose", "ReportedLoop", "list_loops"]

Diagnose = Callable[[str, WindowSamples], Finding | None]
"""Gives the finding of a diagnosis for a loop's newest window, None where there is none."""

NO_WINDOW_YET = (
    "let the daemon run until a window is full; fieldlink status shows how far it is, and which "
    "values are bad"
)

COMPENSATED = (
    "the PLC has accepted a model of this valve and may compensate it, so the newest windows "
    "cannot show it; finding, S and J are of that model"
)

VALID_FOR = 86_400.0
"""Seconds for which a block is valid where no site file is given: the default of a site file."""

WINDOW = 800
"""Samples of a window where no site file gives its length."""


@dataclass(frozen=True, slots=True, eq=False)
class ReportedLoop:
    """A row with what its page of evidence is drawn from.

    Attributes:
        row: of the work list.
        samples: the newest window; None where its samples are gone.
        course: judged windows; None for a recording.
        followed: the smoothed course; None where there is none.
        op_span: OP's span, units of OP.
    """

    row: WorkRow
    samples: WindowSamples | None
    course: Course | None
    followed: Track | None
    op_span: float


def list_loops(
    url: str,
    site: Site | None = None,
    *,
    settings: WorkListSettings | None = None,
    progress: Callable[[str, int, int], None] = lambda _name, _done, _all: None,
    diagnose: Diagnose = lambda _name, _samples: None,
) -> list[ReportedLoop]:
    """Return the loops of a historian, the most urgent first.

    Args:
        url: the historian.
        site: its site file: loops, spans and window lengths; all loops of the historian without.
        settings: see `WorkListSettings`.
        progress: called with a loop's name, how many are done, and how many there are.
        diagnose: finds causes; the estimator's verdict and reasons stand in where it finds none.

    Raises:
        StoreError: there is no historian, or it cannot be read.
    """
    chosen = settings or WorkListSettings()
    found = []
    with FleetReader(url) as store:
        items, repairs = _items(store.work()), _repairs(store.events(REPAIR_KINDS))
        names = store.loops() if site is None else tuple(site.loops)
        together = findings_by_loop(store.findings())
        for number, name in enumerate(names):
            progress(name, number, len(names))
            reader = _LoopReader(store, name, site, chosen, diagnose)
            loop = reader.read(items.get(name), repairs.get(name, []))
            remarks = (*loop.row.remarks, *remarks_of(name, together.get(name, [])))
            found.append(replace(loop, row=replace(loop.row, remarks=remarks)))
    return sorted(found, key=lambda loop: (loop.row.urgency, loop.row.tag))


def _items(rows: Sequence[Mapping[str, Any]]) -> dict[str, WorkItem]:
    """The newest word on each loop."""
    return {
        row["loop"]: WorkItem(row["state"], row["owner"], row["note"], row["time"]) for row in rows
    }


def _repairs(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Repair]]:
    found: dict[str, list[Repair]] = {}
    for row in rows:
        found.setdefault(row["source"], []).append(Repair(row["time"], row["message"]))
    return found


class _LoopReader:
    """Reads one loop."""

    def __init__(
        self,
        store: FleetReader,
        name: str,
        site: Site | None,
        settings: WorkListSettings,
        diagnose: Diagnose,
    ) -> None:
        self._store, self._name, self._site = store, name, site
        self._settings, self._diagnose = settings, diagnose
        self._span, self._remarks = self._op_span()
        self._window = WINDOW if site is None else site.loops[name].window

    def read(self, item: WorkItem | None, noted: list[Repair]) -> ReportedLoop:
        stored = Course.of_frame(self._store.course(self._name), self._span, self._settings)
        newest = next(iter(self._store.documents(self._name)), None)
        shown: Mapping[str, Any] | None = None if newest is None else newest["document"]
        samples = self._samples(shown)
        behind = self._find_behind_block(newest, noted)
        course, document, remarks = stored, shown, self._remarks
        if behind is not None:
            course = stored.until(datetime.fromtimestamp(behind["window_end_ms"] / 1000.0, UTC))
            document, remarks = behind["document"], (*remarks, COMPENSATED)
        followed = course.follow(self._settings.stick_band_limit)
        repair = repair_in(course, followed, noted)
        present = course if repair is None else course.since(repair.time)
        if repair is not None and repair in noted:
            followed = present.follow(self._settings.stick_band_limit)
        finding = self._finding(newest, samples) if behind is None else _of_block(behind)
        S, J = self._intervals(document)
        outlook, days = outlook_of(followed, S, self._settings.stick_band_limit)
        agreeing, judged = present.agreement()
        confidence = present.confidence(is_sure=finding.is_sure)
        sticks = finding.wrong is Wrong.STICKY_VALVE
        row = WorkRow(
            tag=self._name,
            device="" if self._site is None else self._site.loops[self._name].device,
            finding=finding,
            item=item,
            stick_band=S,
            slip_jump=J,
            interval_confidence=0.9 if document is None else float(document["confidence"]),
            limit=self._settings.stick_band_limit,
            trend=trend_of(followed) if sticks else Interval.unknown(),
            days_to_limit=days if sticks else Interval.unknown(),
            worse_since=worse_since(followed) if sticks else None,
            figures=figures_of(samples, shown, self._span),
            confidence=confidence,
            agreeing=agreeing,
            judged=judged,
            windows=len(stored),
            last_window=stored.last,
            repair=None if repair is None else self._compare(course, repair, samples),
            remarks=remarks,
        )
        if sticks:
            row = replace(row, outlook=outlook)
        return ReportedLoop(_with_remarks(row), samples, stored, followed, self._span)

    def _find_behind_block(
        self, newest: Mapping[str, Any] | None, noted: Sequence[Repair]
    ) -> Mapping[str, Any] | None:
        """Return the estimate behind the model that the PLC compensates by; None if it does not.

        A loop under compensation cannot show its valve: that its newest windows find no sticking
        does not mean that the valve is repaired.
        """
        if newest is None or newest["verdict"] == "stiction":
            return None
        behind = self._store.valve_in_use(self._name)
        if behind is None or newest["window_end_ms"] <= behind["window_end_ms"]:
            return None
        has_expired = newest["window_end_ms"] - behind["accepted_ms"] > 1000.0 * self._valid_for()
        repaired = any(1000.0 * one.time.timestamp() > behind["window_end_ms"] for one in noted)
        return None if has_expired or repaired else behind

    def _valid_for(self) -> float:
        """Seconds of the clock for which a block of the loop is valid."""
        if self._site is None:
            return VALID_FOR
        loop = self._site.loops[self._name]
        return loop.writeback.valid_for / self._site.devices[loop.device].speed

    def _op_span(self) -> tuple[float, tuple[str, ...]]:
        known = None if self._site is None else self._site.op_span(self._name)
        if known is not None:
            return known, ()
        span = self._settings.span_of()
        return span, (f"OP's span is taken as {span:g}; give low and high in the register map",)

    def _samples(self, document: Mapping[str, Any] | None) -> WindowSamples | None:
        frame = self._store.samples(self._name, self._window)
        return WindowSamples.of_frame(frame, self._period(document), document)

    def _period(self, document: Mapping[str, Any] | None) -> float:
        if self._site is not None:
            return self._site.loops[self._name].period
        return 1.0 if document is None else float(document["period_s"])

    def _finding(self, newest: Mapping[str, Any] | None, samples: WindowSamples | None) -> Finding:
        document = None if newest is None else newest["document"]
        if samples is not None and (found := self._diagnose(self._name, samples)) is not None:
            return found
        if (found := finding_of_stored(self._store.diagnosis(self._name), newest)) is not None:
            return found
        if document is None:
            return Finding(
                (Cause(Wrong.UNDETERMINED, ("no window has been judged yet",)),),
                (NO_WINDOW_YET,),
                is_sure=False,
            )
        oscillates, period = (False, math.nan) if samples is None else samples.swing
        return finding_of_estimate(
            document, oscillates=oscillates, period_s=period if oscillates else None
        )

    def _intervals(self, document: Mapping[str, Any] | None) -> tuple[Interval, Interval]:
        if document is None or document.get("verdict") != "stiction":
            return Interval.unknown(), Interval.unknown()
        scale = 100.0 / self._span
        return (
            interval_of(document["stick_band"]).scaled(scale),
            interval_of(document["slip_jump"]).scaled(scale),
        )

    def _compare(
        self, course: Course, repair: Repair, samples: WindowSamples | None
    ) -> BeforeAfter:
        before = course.until(repair.time).newest(self._settings.before)
        after = course.since(repair.time).newest(self._settings.before)
        old_documents = self._store.documents(self._name, until=repair.time)
        old = old_documents[0]["document"] if old_documents else None
        new_documents = self._store.documents(self._name)
        new = new_documents[0]["document"] if len(after) and new_documents else None
        frame = self._store.samples(self._name, self._window, until=repair.time)
        was = None
        if len(frame) >= self._window // 2 and _is_near(frame, before):
            was = WindowSamples.of_frame(frame, self._period(old), old)
        return BeforeAfter(
            repair.time,
            repair.source,
            self._side(before, was, old),
            self._side(after, samples if len(after) else None, new),
        )

    def _side(
        self, course: Course, samples: WindowSamples | None, document: Mapping[str, Any] | None
    ) -> Figures:
        """Figures of a side: S and J typical of its windows, the rest of its newest window."""
        found = figures_of(samples, document, self._span)
        return replace(
            found,
            stick_band=course.typical("stick_band"),
            slip_jump=course.typical("slip_jump"),
            windows=len(course),
        )


def _of_block(behind: Mapping[str, Any]) -> Finding:
    return finding_of_estimate(behind["document"], oscillates=False, period_s=None)


def _is_near(frame: pd.DataFrame, before: Course) -> bool:
    """Whether samples belong to the newest window before a repair."""
    last = before.last
    return last is not None and bool(abs((frame["time"].iloc[-1] - last).total_seconds()) < 3600.0)


def _with_remarks(row: WorkRow) -> WorkRow:
    """Say where what people have said and what the loop shows do not fit."""
    state, wrong = row.state, row.finding.wrong
    remarks = list(row.remarks)
    since = "" if row.item is None or row.item.since is None else f" ({row.item.since:%Y-%m-%d})"
    if state in ("done", "verified") and wrong is Wrong.STICKY_VALVE and row.judged:
        remarks.append(f"{state}{since}, and the valve still sticks in the windows since then")
    if state == "done" and wrong is Wrong.QUIET and row.confidence is Confidence.HIGH:
        remarks.append(
            f"done{since}, and {row.agreeing} of {row.judged} windows since then show no sticking: "
            "set it to verified"
        )
    return replace(row, remarks=tuple(remarks))
