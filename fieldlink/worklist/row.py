"""One loop of the work list: everything a maintenance meeting asks, as plain data.

Stick band and slip jump are in % of OP's span. A quantity that is not known is NaN here, null in
JSON and an empty cell in a table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Any

from estimator import Interval
from fieldlink.worklist.finding import Finding, Wrong

__all__ = ["COLUMNS", "BeforeAfter", "Confidence", "Figures", "Outlook", "WorkItem", "WorkRow"]

_ORDER = {
    Wrong.STICKY_VALVE: 0.0,
    Wrong.UNDETERMINED: 2.0,
    Wrong.UNREADABLE: 2.5,
    Wrong.QUIET: 4.0,
}
"""What comes first has the smallest; what is not named here stands behind sticky valves."""


class Confidence(StrEnum):
    """How far the finding can be relied on."""

    HIGH = "high"
    MEDIUM = "medium"
    LOW = "low"


class Outlook(StrEnum):
    """Whether the stick band reaches its limit."""

    REACHED = "reached"
    APPROACHING = "approaching"
    NOT_IN_SIGHT = "not_in_sight"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class WorkItem:
    """What people have said about a loop: state (open, planned, done, verified), owner, note."""

    state: str
    owner: str = ""
    note: str = ""
    since: datetime | None = None


@dataclass(frozen=True, slots=True)
class Figures:
    """What a loop does in a window or a few of them.

    Attributes:
        stick_band, slip_jump: % of OP's span.
        loss: share of PV's variance that sticking makes, 0 to 1.
        pv_std: standard deviation of the control error (of PV without a set-point), units of PV.
        travel_per_day: of OP, % of its span a day.
        reversals_per_day: of OP.
        period_s: of the control error's oscillation; NaN where it has no regular one.
        windows: windows behind the first three.
    """

    stick_band: float = math.nan
    slip_jump: float = math.nan
    loss: float = math.nan
    pv_std: float = math.nan
    travel_per_day: float = math.nan
    reversals_per_day: float = math.nan
    period_s: float = math.nan
    windows: int = 0

    def to_dict(self) -> dict[str, float | int | None]:
        """Plain types."""
        return {
            "stick_band": _plain(self.stick_band),
            "slip_jump": _plain(self.slip_jump),
            "loss": _plain(self.loss),
            "pv_std": _plain(self.pv_std),
            "travel_per_day": _plain(self.travel_per_day),
            "reversals_per_day": _plain(self.reversals_per_day),
            "period_s": _plain(self.period_s),
            "windows": self.windows,
        }


@dataclass(frozen=True, slots=True)
class BeforeAfter:
    """A repair with the figures of both sides.

    Attributes:
        time: of the repair, UTC.
        source: who says so: a note of somebody, or a change that the history shows.
        before, after: figures.
    """

    time: datetime
    source: str
    before: Figures
    after: Figures

    def to_dict(self) -> dict[str, Any]:
        """Plain types."""
        return {
            "time": _iso(self.time),
            "source": self.source,
            "before": self.before.to_dict(),
            "after": self.after.to_dict(),
        }


@dataclass(frozen=True, slots=True)
class WorkRow:
    """One loop.

    Attributes:
        tag, device: the loop and its device; the device is empty for a recording.
        finding: what is wrong and what to do.
        item: state, owner and note; None where nothing was entered.
        stick_band, slip_jump: intervals in % of OP's span.
        interval_confidence: of these intervals.
        limit: stick band, in % of span, that maintenance should not let pass.
        trend: of the stick band, % of span in 30 days.
        days_to_limit: days from the last window to the limit; infinite where it is not reached.
        outlook: the same as a word.
        worse_since: when the stick band began to grow.
        figures: of the newest window.
        confidence: of the finding; None where no window has been judged.
        agreeing, judged: how many of the newest judged windows give the same verdict.
        windows: windows in the history.
        last_window: end of the newest, UTC.
        repair: the last repair; None where there was none.
        remarks: what a reader should know.
    """

    tag: str
    device: str
    finding: Finding
    item: WorkItem | None = None
    stick_band: Interval = Interval.unknown()  # noqa: RUF009  (immutable)
    slip_jump: Interval = Interval.unknown()  # noqa: RUF009
    interval_confidence: float = 0.9
    limit: float = math.nan
    trend: Interval = Interval.unknown()  # noqa: RUF009
    days_to_limit: Interval = Interval.unknown()  # noqa: RUF009
    outlook: Outlook = Outlook.UNKNOWN
    worse_since: datetime | None = None
    figures: Figures = Figures()
    confidence: Confidence | None = None
    agreeing: int = 0
    judged: int = 0
    windows: int = 0
    last_window: datetime | None = None
    repair: BeforeAfter | None = None
    remarks: tuple[str, ...] = ()

    @property
    def state(self) -> str:
        """The state that people gave; without one, what the history shows.

        That is open where something is wrong, done after a repair, and empty otherwise.
        """
        if self.item is not None:
            return self.item.state
        if self.finding.wrong is not Wrong.QUIET:
            return "open"
        return "done" if self.repair is not None else ""

    @property
    def urgency(self) -> tuple[float, ...]:
        """What comes first has the smallest: sticky valves by their band, then what is not known.

        Work that is done waits for its verification behind the open work of its kind.
        """
        wrong = self.finding.wrong
        order = _ORDER.get(wrong, 1.0)
        closed = 1.0 if self.state in ("done", "verified") else 0.0
        if wrong is Wrong.QUIET and self.state not in ("", "verified"):
            order = 3.0
        band = self.stick_band.value if math.isfinite(self.stick_band.value) else 0.0
        days = self.days_to_limit.value if math.isfinite(self.days_to_limit.value) else 1e6
        loss = self.figures.loss if math.isfinite(self.figures.loss) else 0.0
        return (order, closed, 0.0 if band >= self.limit else 1.0, days, -band, -loss)

    def to_dict(self, rank: int) -> dict[str, Any]:
        """Return the row with the names of `COLUMNS`, plain types, null where nothing is known."""
        finding, item, repair = self.finding, self.item, self.repair
        S, J, figures = self.stick_band, self.slip_jump, self.figures
        days = self.days_to_limit
        return {
            "rank": rank,
            "tag": self.tag,
            "device": self.device,
            "wrong": finding.wrong.code,
            "wrong_text": finding.wrong.text,
            "also": [other.code for other in finding.others],
            "action": finding.action.code,
            "action_text": finding.action_text,
            "needs_outage": finding.action.needs_outage,
            "state": self.state,
            "owner": "" if item is None else item.owner,
            "note": "" if item is None else item.note,
            "state_since": None if item is None else _iso(item.since),
            "stick_band": _plain(S.value),
            "stick_band_low": _plain(S.low),
            "stick_band_high": _plain(S.high),
            "slip_jump": _plain(J.value),
            "slip_jump_low": _plain(J.low),
            "slip_jump_high": _plain(J.high),
            "interval_confidence": self.interval_confidence,
            "limit": _plain(self.limit),
            "trend_per_30_days": _plain(self.trend.value),
            "trend_per_30_days_low": _plain(self.trend.low),
            "trend_per_30_days_high": _plain(self.trend.high),
            "outlook": self.outlook.value,
            "days_to_limit": _plain(days.value),
            "days_to_limit_low": _plain(days.low),
            "days_to_limit_high": _plain(days.high),
            "worse_since": _iso(self.worse_since),
            "travel_per_day": _plain(figures.travel_per_day),
            "reversals_per_day": _plain(figures.reversals_per_day),
            "period_s": _plain(figures.period_s),
            "loss": _plain(figures.loss),
            "pv_std": _plain(figures.pv_std),
            "confidence": None if self.confidence is None else self.confidence.value,
            "windows_agreeing": self.agreeing,
            "windows_judged": self.judged,
            "windows": self.windows,
            "last_window": _iso(self.last_window),
            "evidence": list(finding.main.evidence),
            "would_determine": list(finding.would_determine),
            "remarks": list(self.remarks),
            "repaired_at": None if repair is None else _iso(repair.time),
            "repair": None if repair is None else repair.to_dict(),
        }


def _plain(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _iso(moment: datetime | None) -> str | None:
    return None if moment is None else moment.isoformat(timespec="seconds")


COLUMNS: tuple[str, ...] = (
    "rank", "tag", "device", "wrong", "wrong_text", "also", "action", "action_text",
    "needs_outage", "state", "owner", "note", "state_since", "stick_band", "stick_band_low",
    "stick_band_high", "slip_jump", "slip_jump_low", "slip_jump_high", "interval_confidence",
    "limit", "trend_per_30_days", "trend_per_30_days_low", "trend_per_30_days_high", "outlook",
    "days_to_limit", "days_to_limit_low", "days_to_limit_high", "worse_since", "travel_per_day",
    "reversals_per_day", "period_s", "loss", "pv_std", "confidence", "windows_agreeing",
    "windows_judged", "windows", "last_window", "evidence", "would_determine", "remarks",
    "repaired_at", "repair",
)  # fmt: skip
"""The names of a row's values, in their order: the columns of CSV and xlsx, the keys of JSON."""
