"""Figures of the work list in words, short enough for a cell."""

from __future__ import annotations

import math
from datetime import datetime

from estimator import Interval
from fieldlink.worklist.row import BeforeAfter, Figures, Outlook, WorkRow
from fieldlink.worklist.settings import WorkListSettings

__all__ = [
    "before_after_rows",
    "brief_confidence",
    "day_text",
    "duration_text",
    "facts_of",
    "interval_text",
    "limit_text",
    "number",
    "outage_text",
    "share_text",
    "state_text",
    "trend_text",
    "two_lines",
    "wrong_text",
]

NOTHING = "–"

_COUNTED = f"turns below {WorkListSettings().dead_band:g} % left out"


def number(value: float, digits: int = 3) -> str:
    """Return a number, a dash where there is none; large ones without an exponent."""
    if not math.isfinite(value):
        return NOTHING
    return f"{value:.0f}" if abs(value) >= 10.0**digits else f"{value:.{digits}g}"


def interval_text(interval: Interval) -> str:
    """Return ``value [low to high]``, % of span."""
    if not math.isfinite(interval.value):
        return NOTHING
    return f"{number(interval.value)} [{number(interval.low)} to {number(interval.high)}]"


def two_lines(interval: Interval) -> str:
    """Return the value, and its interval on a line of its own."""
    if not math.isfinite(interval.value):
        return NOTHING
    return f"{number(interval.value)}\n{number(interval.low)} to {number(interval.high)}"


def share_text(value: float) -> str:
    """Return a share as per cent."""
    return f"{100.0 * value:.0f} %" if math.isfinite(value) else NOTHING


def duration_text(seconds: float) -> str:
    """Return seconds in the unit in which people say them."""
    if not math.isfinite(seconds):
        return NOTHING
    if seconds < 120.0:
        return f"{number(seconds)} s"
    return f"{number(seconds / 60.0)} min" if seconds < 7200.0 else f"{number(seconds / 3600.0)} h"


def day_text(moment: datetime | None) -> str:
    """Return a date."""
    return NOTHING if moment is None else f"{moment:%Y-%m-%d}"


def trend_text(interval: Interval) -> str:
    """Return the trend in 30 days; steady where its interval has both signs."""
    if not math.isfinite(interval.value):
        return NOTHING
    is_clear = interval.low > 0.0 or interval.high < 0.0
    return f"{interval.value:+.2f}" if is_clear else "steady"


def limit_text(row: WorkRow) -> str:
    """Return in how many days the limit is reached."""
    days = row.days_to_limit
    if row.outlook is Outlook.REACHED:
        return "over the limit"
    if row.outlook is Outlook.UNKNOWN:
        return NOTHING
    if row.outlook is Outlook.NOT_IN_SIGHT:
        return "not in 10 years"
    late = number(days.high) if math.isfinite(days.high) else "never"
    return f"{number(days.value)} days\n{number(days.low)} to {late}"


def outage_text(row: WorkRow) -> str:
    """Return whether the action needs an outage."""
    if row.finding.action.code == "nothing":
        return NOTHING
    return "yes" if row.finding.action.needs_outage else "no"


def wrong_text(row: WorkRow) -> str:
    """Return what is wrong, and what else is."""
    others = ", ".join(other.text for other in row.finding.others)
    return row.finding.wrong.text + (f"; also {others}" if others else "")


def state_text(row: WorkRow) -> str:
    """Return the state and since when."""
    if row.item is None or row.item.since is None:
        return row.state or NOTHING
    return f"{row.state}\n{day_text(row.item.since)}"


def facts_of(row: WorkRow) -> list[tuple[str, str]]:
    """Return the figures of a loop, each with its name, unit included."""
    figures, percent = row.figures, f"{100.0 * row.interval_confidence:.0f} % interval"
    facts = [
        ("stick band S, % of OP's span", f"{interval_text(row.stick_band)} ({percent})"),
        ("slip jump J, % of OP's span", interval_text(row.slip_jump)),
        ("limit of S, % of OP's span", number(row.limit)),
        ("trend of S, % of span in 30 days", interval_text(row.trend)),
        ("days to the limit", limit_text(row)),
        ("growing since", day_text(row.worse_since)),
        ("period of the control error's oscillation", duration_text(figures.period_s)),
        ("avoidable: share of PV's variance that sticking makes", share_text(figures.loss)),
        ("standard deviation of the control error", number(figures.pv_std)),
        (f"travel of OP, % of span a day, {_COUNTED}", number(figures.travel_per_day)),
        (f"reversals of OP a day, {_COUNTED}", number(figures.reversals_per_day)),
        ("confidence", confidence_text(row)),
        ("windows in the history", number(row.windows)),
        ("end of the newest window", day_text(row.last_window)),
    ]
    empty = (NOTHING, f"{NOTHING} ({percent})")
    return [(name, text) for name, text in facts if text not in empty]


def brief_confidence(row: WorkRow) -> str:
    """Return the confidence, and how many windows agree."""
    if row.confidence is None:
        return NOTHING
    return f"{row.confidence.value}\n{row.agreeing} of {row.judged}"


def confidence_text(row: WorkRow) -> str:
    """Return the confidence and what it rests on."""
    if row.confidence is None:
        return NOTHING
    return f"{row.confidence.value}: {row.agreeing} of {row.judged} newest windows agree"


def before_after_rows(repair: BeforeAfter) -> list[tuple[str, str, str]]:
    """Return the figures of both sides of a repair: name, before, after."""

    def pair(name: str, text: str, digits: int = 3) -> tuple[str, str, str]:
        sides = (repair.before, repair.after)
        return (text, *(number(getattr(side, name), digits) for side in sides))  # type: ignore[return-value]

    def shares(side: Figures) -> str:
        return share_text(side.loss)

    rows = [
        pair("stick_band", "stick band S, % of OP's span"),
        pair("slip_jump", "slip jump J, % of OP's span"),
        (
            "avoidable: share of PV's variance that sticking makes",
            shares(repair.before),
            shares(repair.after),
        ),
        pair("pv_std", "standard deviation of the control error"),
        pair("travel_per_day", "travel of OP, % of span a day"),
        pair("reversals_per_day", "reversals of OP a day"),
        (
            "period of the oscillation",
            duration_text(repair.before.period_s),
            duration_text(repair.after.period_s),
        ),
        ("windows", str(repair.before.windows), str(repair.after.windows)),
    ]
    return [row for row in rows if row[1:] != (NOTHING, NOTHING)]
