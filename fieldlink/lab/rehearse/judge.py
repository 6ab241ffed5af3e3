"""Whether a run came as expected: one finding for each expectation, in words and as a yes or no."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldlink.lab.rehearse.expected import (
    END,
    BlocksExpected,
    ChangeExpected,
    EstimateExpected,
    EventExpected,
    Expectation,
    FallBackExpected,
    PvExpected,
    SamplesExpected,
    TakeOverExpected,
    VerdictExpected,
)
from fieldlink.lab.rehearse.outcome import RunCourse, Window

__all__ = ["Finding", "judge"]


@dataclass(frozen=True, slots=True)
class Finding:
    """What was expected, what was found, and whether that is good."""

    expected: str
    found: str
    passed: bool

    def to_dict(self) -> dict[str, object]:
        """Plain types."""
        return {"expected": self.expected, "found": self.found, "passed": self.passed}


def judge(expected: Expectation, course: RunCourse) -> Finding:
    """Judge one expectation."""
    return _JUDGES[type(expected)](expected, course)


def _verdict(expected: VerdictExpected, course: RunCourse) -> Finding:
    windows = _windows(expected, course)
    hits = [
        window.verdict == expected.verdict and expected.reason.lower() in window.reasons.lower()
        for window in windows
    ]
    because = f" ({expected.reason})" if expected.reason else ""
    said = f"verdict {expected.verdict}{because} in {expected.windows} of the windows"
    seen = ", ".join(f"{window.end:g} s {window.verdict or 'refused'}" for window in windows)
    return _of_windows(said, expected, hits, seen)


def _estimate(expected: EstimateExpected, course: RunCourse) -> Finding:
    windows = _windows(expected, course)
    name = {"stick_band": "S", "slip_jump": "J"}[expected.of]
    hits, shown = [], []
    for window in windows:
        low, high = _true_range(course, window, expected.of)
        found = getattr(window, expected.of)
        near = low * (1.0 - expected.tolerance) <= found.value <= high * (1.0 + expected.tolerance)
        held = not expected.covered or (found.low <= high and low <= found.high)
        hits.append(near and held)
        true = f"{low:.3g}" if high - low <= 0.005 * high else f"{low:.3g} to {high:.3g}"
        estimate = f"{found.value:.3g} [{found.low:.3g}, {found.high:.3g}]"
        known = estimate if math.isfinite(found.value) else "no estimate"
        shown.append(f"{window.end:g} s {known}, true {true}")
    said = f"{name} within {expected.tolerance:.0%} of the truth"
    if expected.covered:
        said += " and its interval holds it"
    return _of_windows(
        f"{said} in {expected.windows} of the windows", expected, hits, "; ".join(shown)
    )


def _true_range(course: RunCourse, window: Window, name: str) -> tuple[float, float]:
    """Lowest and highest true value during a window."""
    trend = course.trend
    inside = (trend.time >= window.begin) & (trend.time < window.end)
    values: NDArray[np.float64] = getattr(trend, name)[inside]
    return (float(values.min()), float(values.max())) if values.size else (math.nan, math.nan)


def _take_over(expected: TakeOverExpected, course: RunCourse) -> Finding:
    moment = _first(course.trend.time, course.trend.compensated, expected.after)
    found = "never" if moment is None else f"at {moment:g} s"
    since = f" after {expected.after:g} s" if expected.after else ""
    if expected.never:
        return Finding(f"the compensator never has the loop{since}", found, moment is None)
    assert expected.by is not None
    said = f"the compensator has the loop{since} by {expected.by:g} s"
    return Finding(said, found, moment is not None and moment <= expected.by)


def _fall_back(expected: FallBackExpected, course: RunCourse) -> Finding:
    trend = course.trend
    given_up = np.zeros(trend.time.size, bool)
    given_up[1:] = trend.compensated[:-1] & ~trend.compensated[1:]
    wanted = f" ({', '.join(expected.reason)})" if expected.reason else ""
    since = f" after {expected.after:g} s" if expected.after else ""
    said = f"the controller has the loop back{wanted}{since} by {expected.by:g} s"
    falls = [
        (float(trend.time[k]), trend.reason[k])
        for k in np.flatnonzero(given_up)
        if trend.time[k] >= expected.after
    ]
    found = ", ".join(f"at {time:g} s ({reason or 'PLC off'})" for time, reason in falls)
    passed = any(
        time <= expected.by and (not expected.reason or reason in expected.reason)
        for time, reason in falls
    )
    return Finding(said, found or "never", passed)


def _pv_std(expected: PvExpected, course: RunCourse) -> Finding:
    first, then = (_deviation(course, span) for span in (expected.first, expected.then))
    ratio = then / first if first > 0.0 else math.nan
    bounds = [
        text
        for text, bound in (
            (f"at least {expected.at_least}", expected.at_least),
            (f"at most {expected.at_most}", expected.at_most),
        )
        if bound is not None
    ]
    spans = [f"{begin:g} to {end:g} s" for begin, end in (expected.then, expected.first)]
    passed = (expected.at_most is None or ratio <= expected.at_most) and (
        expected.at_least is None or ratio >= expected.at_least
    )
    return Finding(
        f"PV deviates {' and '.join(bounds)} times as much in {spans[0]} as in {spans[1]}",
        f"{ratio:.3g} ({then:.3g} over {first:.3g})",
        passed,
    )


def _deviation(course: RunCourse, span: tuple[float, float]) -> float:
    """Standard deviation of the true PV minus SP in a time."""
    trend = course.trend
    inside = (trend.time >= span[0]) & (trend.time < span[1])
    error = (trend.pv - trend.sp)[inside]
    error = error[np.isfinite(error)]
    return float(np.std(error)) if error.size > 1 else math.nan


def _blocks(expected: BlocksExpected, course: RunCourse) -> Finding:
    times = [
        record.utc_ms / 1000.0
        for record in course.writebacks
        if record.outcome == "accepted"
        and expected.status in ("any", record.status)
        and record.utc_ms / 1000.0 >= expected.after
    ]
    what = "blocks" if expected.status == "any" else f"blocks of status {expected.status}"
    since = f" after {expected.after:g} s" if expected.after else ""
    found = f"{len(times)}" + (f" (at {', '.join(f'{t:g}' for t in times)} s)" if times else "")
    if not times:
        found += _last_outcome(course)
    return _count(f"{what} accepted{since}", len(times), found, expected)


def _last_outcome(course: RunCourse) -> str:
    if not course.writebacks:
        return " (nothing was offered)"
    last = course.writebacks[-1]
    return f" (last: {last.outcome}, {last.reason})"


def _samples(expected: SamplesExpected, course: RunCourse) -> Finding:
    number = getattr(course.counts, expected.of)
    return _count(f"samples: {expected.of}", number, str(number), expected)


def _event(expected: EventExpected, course: RunCourse) -> Finding:
    times = [
        record.utc_ms / 1000.0
        for record in course.events
        if record.kind == expected.event and record.utc_ms / 1000.0 >= expected.after
    ]
    shown = ", ".join(f"{time:g}" for time in times[:8]) + (", ..." if len(times) > 8 else "")
    found = f"at {shown} s" if times else "never"
    since = f" after {expected.after:g} s" if expected.after else ""
    if expected.never:
        return Finding(f"no event {expected.event}{since}", found, not times)
    assert expected.by is not None
    return Finding(
        f"event {expected.event}{since} by {expected.by:g} s",
        found,
        any(time <= expected.by for time in times),
    )


def _change(expected: ChangeExpected, course: RunCourse) -> Finding:
    series = None if course.track is None else course.track.stick_band
    changes = () if series is None else series.changes
    onsets = [
        float(series.times[change.onset])
        for change in changes
        if series is not None and change.kind.value == expected.direction
    ]
    found = ", ".join(f"{onset:g} s" for onset in onsets) or "none"
    if expected.never:
        return Finding(f"tracking of S finds no {expected.direction}", found, not onsets)
    assert expected.at is not None
    passed = any(abs(onset - expected.at) <= expected.within for onset in onsets)
    said = f"tracking of S finds the {expected.direction} of {expected.at:g} s"
    return Finding(f"{said} within {expected.within:g} s", found, passed)


_JUDGES: dict[type, Callable[[Any, RunCourse], Finding]] = {
    VerdictExpected: _verdict,
    EstimateExpected: _estimate,
    TakeOverExpected: _take_over,
    FallBackExpected: _fall_back,
    PvExpected: _pv_std,
    BlocksExpected: _blocks,
    SamplesExpected: _samples,
    EventExpected: _event,
    ChangeExpected: _change,
}


def _windows(expected: VerdictExpected | EstimateExpected, course: RunCourse) -> list[Window]:
    return [w for w in course.windows if expected.after <= w.end <= expected.before]


def _of_windows(
    said: str,
    expected: VerdictExpected | EstimateExpected,
    hits: Sequence[bool],
    seen: str,
) -> Finding:
    if expected.after:
        said += f" from {expected.after:g} s"
    if expected.before < END:
        said += f" to {expected.before:g} s"
    if not hits:
        return Finding(said, "no window ended in that time", False)
    passed = {"all": all(hits), "any": any(hits), "none": not any(hits)}[expected.windows]
    return Finding(said, seen, passed)


def _count(
    what: str, number: int, found: str, expected: BlocksExpected | SamplesExpected
) -> Finding:
    bounds = [f"at least {expected.at_least}"] if expected.at_least else []
    if expected.at_most is not None:
        bounds.append(f"at most {expected.at_most}")
    passed = number >= expected.at_least and (
        expected.at_most is None or number <= expected.at_most
    )
    return Finding(f"{what}, {' and '.join(bounds) or 'any number'}", found, passed)


def _first(time: NDArray[np.float64], flag: NDArray[np.bool_], after: float) -> float | None:
    hits = np.flatnonzero(flag & (time >= after))
    return float(time[hits[0]]) if hits.size else None
