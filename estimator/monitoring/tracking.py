"""A valve over many windows: smoothed stick band and slip jump, changes, and the time that is left.

course = track(times, [r.stick_band for r in results], [r.slip_jump for r in results],
               stick_band_limit=5.0)
course.stick_band.worse_since, course.stick_band.days_to_limit
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from estimator.monitoring.changes import Change, ChangeKind, find_changes
from estimator.monitoring.trend import Trend, smooth_trend
from estimator.outcomes import EstimatorError
from estimator.result import Interval

__all__ = ["Track", "TrackedSeries", "track"]

Array = NDArray[np.float64]

_DAY = 86400.0
_HORIZON_DAYS = 3650.0
_LEAST_DAYS = 1.0
"""Days that windows have to span before a slope per day is told. Within a day estimates move with
load and operating point; carried on for 30 days, a tenth of a percent in ten minutes is 400 %."""


@dataclass(frozen=True, slots=True)
class TrackedSeries:
    """One quantity over time.

    Attributes:
        times: of the windows, in seconds as given, shape ``(n,)``.
        value, low, high: smoothed, with intervals, shape ``(n,)``; NaN while nothing is known.
        trend_per_day: slope at the end with its interval, per day; unknown with fewer than three
            windows, or less than a day, since the last decrease.
        changes: what the CUSUM found; indices of windows.
        days_to_limit: days from the last window until the limit is reached at the present trend;
            infinite when it is not, unknown without a limit or a trend.
    """

    times: Array
    value: Array
    low: Array
    high: Array
    trend_per_day: Interval
    changes: tuple[Change, ...]
    days_to_limit: Interval

    @property
    def worse_since(self) -> float | None:
        """Time of the first increase after the last decrease; None when it did not increase."""
        onset: float | None = None
        for change in self.changes:
            if change.kind is ChangeKind.DECREASE:
                onset = None
            elif onset is None:
                onset = float(self.times[change.onset])
        return onset


@dataclass(frozen=True, slots=True)
class Track:
    """The course of a valve: both parameters, in units of OP."""

    stick_band: TrackedSeries
    slip_jump: TrackedSeries
    confidence: float


def track(
    times: ArrayLike,
    stick_band: Sequence[Interval],
    slip_jump: Sequence[Interval],
    *,
    stick_band_limit: float | None = None,
    slip_jump_limit: float | None = None,
    confidence: float = 0.9,
) -> Track:
    """Follow a valve over successive windows.

    Args:
        times: of the windows, seconds, strictly increasing, shape ``(n,)``.
        stick_band, slip_jump: their estimates, ``n`` each, with intervals at ``confidence``; an
            unknown interval (NaN) is a window that said nothing.
        stick_band_limit, slip_jump_limit: what maintenance should not let pass, units of OP.
        confidence: of the intervals given and returned.

    Raises:
        EstimatorError: lengths differ, times do not increase, an interval is upside down, or no
            window says anything.
    """
    time = np.asarray(times, dtype=np.float64)
    if time.ndim != 1 or not (time.size == len(stick_band) == len(slip_jump)):
        raise EstimatorError(
            f"times, stick_band and slip_jump must have one length; got {time.shape}, "
            f"{len(stick_band)} and {len(slip_jump)}"
        )
    if not np.isfinite(time).all() or (np.diff(time) <= 0.0).any():
        raise EstimatorError("times must be finite and strictly increasing (seconds)")
    if not 0.5 <= confidence <= 0.999:
        raise EstimatorError(f"confidence is {confidence!r}: give a share from 0.5 to 0.999")
    return Track(
        stick_band=_follow("stick_band", time, stick_band, stick_band_limit, confidence),
        slip_jump=_follow("slip_jump", time, slip_jump, slip_jump_limit, confidence),
        confidence=confidence,
    )


def _follow(
    name: str,
    time: Array,
    intervals: Sequence[Interval],
    limit: float | None,
    confidence: float,
) -> TrackedSeries:
    quantile = float(ndtri(0.5 + 0.5 * confidence))
    value, std = _observations(name, intervals, quantile)
    changes = find_changes(value, std)
    level = np.full(time.size, np.nan)
    spread = np.full(time.size, np.nan)
    # What was before a repair says nothing of the valve after it.
    starts = [0, *(c.onset for c in changes if c.kind is ChangeKind.DECREASE)]
    trend: Trend | None = None
    known, days = 0, 0.0
    for begin, end in zip(starts, [*starts[1:], time.size], strict=True):
        seen = np.flatnonzero(np.isfinite(value[begin:end]))
        if seen.size == 0:
            continue
        part = slice(begin + int(seen[0]), end)
        trend = smooth_trend(time[part] / _DAY, value[part], std[part])
        known = int(seen.size)
        days = float(time[begin + seen[-1]] - time[begin + seen[0]]) / _DAY
        level[part], spread[part] = trend.level, trend.level_std
    slope, left = Interval.unknown(), Interval.unknown()
    if trend is not None and known >= 3 and days >= _LEAST_DAYS:
        centre, half = float(trend.slope[-1]), quantile * float(trend.slope_std[-1])
        slope = Interval(centre, centre - half, centre + half)
        if limit is not None:
            left = _days_to(limit, trend, quantile)
    return TrackedSeries(
        times=time,
        value=level,
        low=np.maximum(level - quantile * spread, 0.0),
        high=level + quantile * spread,
        trend_per_day=slope,
        changes=changes,
        days_to_limit=left,
    )


def _observations(name: str, intervals: Sequence[Interval], quantile: float) -> tuple[Array, Array]:
    """Values and standard deviations; a width of nothing is taken for a thousandth of the value."""
    value = np.array([one.value for one in intervals], dtype=np.float64)
    width = np.array([one.high - one.low for one in intervals], dtype=np.float64)
    value[~np.isfinite(width)] = np.nan
    if not np.isfinite(value).any():
        raise EstimatorError(f"no window has a {name} with an interval: nothing to follow")
    if (width < 0.0).any():
        first = int(np.flatnonzero(width < 0.0)[0])
        raise EstimatorError(
            f"{name} of window {first} has an interval whose low end is above its high end"
        )
    floor = 1e-3 * max(float(np.nanmedian(np.abs(value))), 1e-9)
    return value, np.maximum(width / (2.0 * quantile), floor)


def _days_to(limit: float, trend: Trend, quantile: float) -> Interval:
    """First day on which the level, its lower and its upper bound reach the limit."""
    days = np.concatenate([[0.0], np.geomspace(0.01, _HORIZON_DAYS, 4000)])
    level, std = trend.forecast(days)

    def first(course: Array) -> float:
        over = np.flatnonzero(course >= limit)
        if over.size == 0:
            return math.inf
        k = int(over[0])
        if k == 0:
            return 0.0
        share = (limit - course[k - 1]) / (course[k] - course[k - 1])
        return float(days[k - 1] + share * (days[k] - days[k - 1]))

    return Interval(first(level), first(level + quantile * std), first(level - quantile * std))
