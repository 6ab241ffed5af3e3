"""Figures and codes as people read them; every text that a page shows of one is made here."""

from __future__ import annotations

import math
from datetime import UTC, datetime

__all__ = [
    "BLOCK_WORDS",
    "VERDICTS",
    "Verdict",
    "duration_text",
    "iso_time",
    "moment_text",
    "number_text",
    "percent_text",
    "verdict_of",
]

MISSING = "\N{EN DASH}"


class Verdict:
    """How a verdict looks: a word, a sign beside the colour, and the class of its colour."""

    def __init__(self, word: str, sign: str, style: str, order: int) -> None:
        self.word, self.sign, self.style, self.order = word, sign, style, order


VERDICTS = {
    "stiction": Verdict("sticky", "\N{BLACK UP-POINTING TRIANGLE}", "bad", 0),
    "stiction?": Verdict("sticky?", "\N{WHITE UP-POINTING TRIANGLE}", "warn", 1),
    "not_assessable": Verdict("undetermined", "?", "unknown", 2),
    "": Verdict("no result yet", "\N{HORIZONTAL ELLIPSIS}", "unknown", 3),
    "no_stiction": Verdict("healthy", "\N{CHECK MARK}", "good", 4),
}
"""By the estimator's word; ``stiction?`` is one that the estimator itself doubts."""

BLOCK_WORDS = {
    "valid": "model in the PLC",
    "no_stiction": "healthy valve noted in the PLC",
    "not_assessable": "no model: not assessable",
    "withdrawn": "withdrawn",
}


def verdict_of(verdict: str | None, *, uncertain: bool) -> Verdict:
    """Return how a verdict looks."""
    if verdict is None:
        return VERDICTS[""]
    doubted = VERDICTS.get(f"{verdict}?") if uncertain else None
    return doubted or VERDICTS[verdict]


def number_text(value: float | None, digits: int = 3, unit: str = "") -> str:
    """Return a number with so many significant digits, never as a power of ten below a million."""
    if value is None or not math.isfinite(value):
        return MISSING
    if value == 0.0:
        text = "0"
    else:
        places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
        text = f"{value:,.{min(places, 6)}f}".replace(",", "\N{NARROW NO-BREAK SPACE}")
    return f"{text}\N{NO-BREAK SPACE}{unit}" if unit else text


def percent_text(share: float | None) -> str:
    """Return a share as percent."""
    if share is None or not math.isfinite(share):
        return MISSING
    percent = 100.0 * share
    if 99.5 <= percent < 100.0 or 0.0 < percent < 1.0:
        return f"{percent:.1f}\N{NO-BREAK SPACE}%"
    return f"{percent:.0f}\N{NO-BREAK SPACE}%"


def duration_text(seconds: float | None) -> str:
    """Return a duration in the unit that suits it."""
    if seconds is None or not math.isfinite(seconds):
        return MISSING
    for limit, unit, size in (
        (120.0, "s", 1.0),
        (7200.0, "min", 60.0),
        (172_800.0, "h", 3600.0),
        (math.inf, "days", 86_400.0),
    ):
        if abs(seconds) < limit:
            return number_text(seconds / size, 2 if abs(seconds) / size < 10 else 3, unit)
    return MISSING


def iso_time(utc_ms: float | None) -> str | None:
    """Return UTC milliseconds as ISO 8601, None for None."""
    if utc_ms is None:
        return None
    return datetime.fromtimestamp(utc_ms / 1000.0, UTC).isoformat(timespec="seconds")


def moment_text(utc_ms: float | None) -> str:
    """Return a moment in UTC as the pages show it without a script; a script shows local time."""
    if utc_ms is None:
        return MISSING
    return f"{datetime.fromtimestamp(utc_ms / 1000.0, UTC):%Y-%m-%d %H:%M:%S} UTC"
