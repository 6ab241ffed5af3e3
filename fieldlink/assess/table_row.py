"""The row of a window: what the table has of it."""

from __future__ import annotations

import math
import time
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fieldlink.assess.job import Judging
    from fieldlink.assess.series import Series

__all__ = ["COLUMNS", "NUMBERS", "error_row", "judge_window", "moment_text"]

COLUMNS = (
    "file",
    "loop",
    "start",
    "samples",
    "period_s",
    "verdict",
    "score",
    "stick_band",
    "stick_band_low",
    "stick_band_high",
    "slip_jump",
    "cause",
    "action",
    "seconds",
    "error",
    "notes",
)
"""A contract with everyone who reads the table."""

NUMBERS = frozenset(
    ("period_s", "score", "stick_band", "stick_band_low", "stick_band_high", "slip_jump", "seconds")
)

Row = dict[str, Any]


def judge_window(file: str, loop: str, window: Series, judging: Judging) -> Row:
    """Return the row of one window.

    Raises:
        EstimatorError: the samples are not a window, such as a PV without any number.
    """
    from estimator import identify
    from fieldlink.assess.causes import cause_of

    begun = time.perf_counter()
    result = identify(
        window.op,
        window.pv,
        sp=window.sp,
        auto=window.auto,
        period=window.period,
        criterion=judging.criterion,
        confidence=judging.confidence,
    )
    cause = cause_of(result, window)
    band = result.stick_band
    return {
        "file": file,
        "loop": loop,
        "start": moment_text(float(window.time[0]), dated=window.dated),
        "samples": result.samples,
        "period_s": result.period_s,
        "verdict": result.verdict.value,
        "score": _number(result.shown_score),
        "stick_band": _number(band.value),
        "stick_band_low": _number(band.low),
        "stick_band_high": _number(band.high),
        "slip_jump": _number(result.slip_jump.value),
        "cause": cause.name,
        "action": cause.action,
        "seconds": time.perf_counter() - begun,
        "error": None,
        "notes": "; ".join(window.notes) or None,
    }


def error_row(file: str, loop: str, start: str, message: str) -> Row:
    """Return the row of what could not be judged; the message names neither file nor loop."""
    row: Row = dict.fromkeys(COLUMNS)
    row.update(file=file, loop=loop, start=start, error=message)
    return row


def moment_text(seconds: float, *, dated: bool) -> str:
    """A window's start: UTC in ISO 8601; in a recording without dates, seconds from its start."""
    if not dated:
        return f"{seconds:.10g}"
    milliseconds = round(1000.0 * seconds)
    moment = datetime.fromtimestamp(milliseconds // 1000, UTC)
    fraction = f".{milliseconds % 1000:03d}" if milliseconds % 1000 else ""
    return f"{moment:%Y-%m-%dT%H:%M:%S}{fraction}Z"


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
