"""A loop's estimates over weeks: trend, outlook, changes, and the figures before a repair.

Estimates of a long history are combined to a bounded number of points, each the mean of its
estimates weighted by their intervals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator import Interval, Track, track
from estimator.monitoring.changes import ChangeKind
from fieldlink.worklist.row import Confidence, Outlook
from fieldlink.worklist.settings import WorkListSettings

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Course", "Repair", "outlook_of", "repair_in", "trend_of", "worse_since"]

Array = NDArray[np.float64]

_DAYS = 30.0
_SILENT = "not_assessable"
_RUN = 3
"""Windows in a row that make a verdict a state of the valve: two can be chance, and a repair is
compared with what was before it."""


@dataclass(frozen=True, slots=True)
class Repair:
    """When a valve was repaired, UTC, and the source."""

    time: datetime
    source: str


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """The judged windows of one loop, oldest first.

    Attributes:
        times: ends of the windows, seconds since 1970, shape ``(n,)``.
        verdicts: as many.
        stick_band, slip_jump: value, low and high in % of OP's span, shape ``(n, 3)``; NaN where
            the window does not tell.
        settings: see `WorkListSettings`.
    """

    times: Array
    verdicts: tuple[str, ...]
    stick_band: Array
    slip_jump: Array
    settings: WorkListSettings

    @classmethod
    def of_frame(cls, frame: pd.DataFrame, span: float, settings: WorkListSettings) -> Course:
        """Build from `fieldlink.store.FleetReader.course`.

        Args:
            frame: the estimates.
            span: OP's span, units of OP.
            settings: see `WorkListSettings`.
        """
        judged = frame[frame["verdict"].notna()].drop_duplicates("window_end_ms", keep="last")
        judged = judged.sort_values("window_end_ms")
        # A valve that is not found sticky has no stick band; the estimator still names the best.
        sticky = (judged["verdict"] == "stiction").to_numpy()
        bands, jumps = (
            100.0 / span * judged[[name, f"{name}_low", f"{name}_high"]].to_numpy(dtype=np.float64)
            for name in ("stick_band", "slip_jump")
        )
        bands[~sticky], jumps[~sticky] = np.nan, np.nan
        times = judged["window_end_ms"].to_numpy(dtype=np.float64) / 1000.0
        return cls(times, tuple(map(str, judged["verdict"])), bands, jumps, settings)

    def __len__(self) -> int:
        return int(self.times.size)

    @property
    def last(self) -> datetime | None:
        """End of the newest window."""
        return _moment(self.times[-1]) if len(self) else None

    def since(self, moment: datetime) -> Course:
        """Return the windows that end after ``moment``."""
        return self._cut(self.times > moment.timestamp())

    def until(self, moment: datetime) -> Course:
        """Return the windows that end before ``moment``, or with it."""
        return self._cut(self.times <= moment.timestamp())

    def newest(self, count: int) -> Course:
        """Return the newest windows."""
        return self._cut(np.arange(len(self)) >= len(self) - count)

    def agreement(self) -> tuple[int, int]:
        """Return how many of the newest judged windows say what the newest says, and of how many.

        Windows that cannot be judged count only when the newest cannot be judged either.
        """
        if not len(self):
            return 0, 0
        newest = self.verdicts[-1]
        judged = [v for v in self.verdicts if v != _SILENT or newest == _SILENT]
        recent = judged[-self.settings.recent :]
        return sum(verdict == newest for verdict in recent), len(recent)

    def confidence(self, *, is_sure: bool) -> Confidence | None:
        """Return how far the newest verdict can be relied on; None without a window."""
        agreeing, judged = self.agreement()
        if judged == 0:
            return None
        if not is_sure:
            return Confidence.LOW
        if judged >= 2 and agreeing >= self.settings.agreement * judged:
            return Confidence.HIGH
        return Confidence.LOW if 2 * agreeing <= judged else Confidence.MEDIUM

    def follow(self, limit: float) -> Track | None:
        """Return the course followed through time; None where no window has an interval.

        Args:
            limit: stick band, % of span.
        """
        combined = self.combined()
        known = np.isfinite(combined.stick_band).all(axis=1)
        if not known.any():
            return None
        # The list has no trend of the slip jump: a single one is followed at once.
        jumps = [*(Interval.unknown() for _ in combined.times[1:]), Interval(0.0, 0.0, 0.0)]
        return track(
            combined.times,
            [_interval(row) for row in combined.stick_band],
            jumps,
            stick_band_limit=limit,
        )

    def combined(self) -> Course:
        """Return at most `WorkListSettings.points` points, the newest window the last of them."""
        n, most = len(self), self.settings.points
        if n <= most:
            return self
        groups = np.array_split(np.arange(n), most)
        last = [group[-1] for group in groups]
        return replace(
            self,
            times=self.times[last],
            verdicts=tuple(self.verdicts[k] for k in last),
            stick_band=np.array([_mean(self.stick_band[group]) for group in groups]),
            slip_jump=np.array([_mean(self.slip_jump[group]) for group in groups]),
        )

    def typical(self, which: str) -> float:
        """Return the median of ``stick_band`` or ``slip_jump``, % of span; NaN where unknown.

        A valve that most windows call healthy has none: one window that began before a repair and
        ended after it does not tell what the repair brought. Of as many the newest decides.
        """
        judged = [verdict == "stiction" for verdict in self.verdicts if verdict != _SILENT]
        if judged and sum(judged) + 0.5 * judged[-1] <= 0.5 * len(judged):
            return math.nan
        values = getattr(self, which)[:, 0]
        known = values[np.isfinite(values)]
        return float(np.median(known)) if known.size else math.nan

    def _cut(self, mask: NDArray[np.bool_]) -> Course:
        return replace(
            self,
            times=self.times[mask],
            verdicts=tuple(v for v, kept in zip(self.verdicts, mask, strict=True) if kept),
            stick_band=self.stick_band[mask],
            slip_jump=self.slip_jump[mask],
        )


def repair_in(course: Course, followed: Track | None, annotated: Sequence[Repair]) -> Repair | None:
    """Return the last repair: from a note, or seen in the history.

    What is seen is a fall of the stick band, or a valve that sticks no more for some windows.
    """
    found = [*annotated, *_cures(course)]
    if followed is not None:
        band = followed.stick_band
        found.extend(
            Repair(_moment(band.times[change.onset - 1]), "the stick band fell")
            for change in band.changes
            if change.kind is ChangeKind.DECREASE and change.onset > 0
        )
    if not found:
        return None
    newest = max(found, key=lambda repair: repair.time)
    # A note and the change that it explains are one repair; what people say has the better time.
    noted = [repair for repair in annotated if repair.time <= newest.time]
    if newest not in annotated and noted:
        closest = max(noted, key=lambda repair: repair.time)
        at, to = closest.time.timestamp(), newest.time.timestamp()
        if np.count_nonzero((course.times > at) & (course.times <= to)) < _RUN:
            return closest
    return newest


def _cures(course: Course) -> list[Repair]:
    """Where a valve that stuck in some judged windows in a row sticks no more in as many."""
    judged = [k for k, verdict in enumerate(course.verdicts) if verdict != _SILENT]
    sticks = [course.verdicts[k] == "stiction" for k in judged]
    return [
        Repair(_moment(course.times[judged[k - 1]]), "the valve sticks no more")
        for k in range(_RUN, len(judged) - _RUN + 1)
        if all(sticks[k - _RUN : k]) and not any(sticks[k : k + _RUN])
    ]


def trend_of(followed: Track | None) -> Interval:
    """Return the slope of the stick band, % of span in 30 days."""
    if followed is None:
        return Interval.unknown()
    return followed.stick_band.trend_per_day.scaled(_DAYS)


def outlook_of(followed: Track | None, newest: Interval, limit: float) -> tuple[Outlook, Interval]:
    """Return whether and in how many days the stick band reaches ``limit`` (% of span)."""
    if math.isfinite(newest.value) and newest.value >= limit:
        return Outlook.REACHED, Interval(0.0, 0.0, 0.0)
    if followed is None:
        return Outlook.UNKNOWN, Interval.unknown()
    days = followed.stick_band.days_to_limit
    if math.isnan(days.value):
        return Outlook.UNKNOWN, days
    reached = math.isfinite(days.value)
    return (Outlook.APPROACHING if reached else Outlook.NOT_IN_SIGHT), days


def worse_since(followed: Track | None) -> datetime | None:
    """Return when the stick band began to grow; None where it did not."""
    onset = None if followed is None else followed.stick_band.worse_since
    return None if onset is None else _moment(onset)


def _mean(rows: Array) -> Array:
    """The mean of intervals, the narrow ones weighing more; its own interval is narrower."""
    good = rows[np.isfinite(rows).all(axis=1)]
    if not good.size:
        return np.full(3, np.nan)
    half = 0.5 * (good[:, 2] - good[:, 1])
    floor = 1e-3 * max(float(np.abs(good[:, 0]).max()), 1e-9)
    weight = 1.0 / np.maximum(half, floor) ** 2
    value = float(weight @ good[:, 0] / weight.sum())
    own = 1.0 / math.sqrt(float(weight.sum()))
    # Estimates that scatter more than their intervals allow have a mean that does so too.
    scatter = float(good[:, 0].std()) / math.sqrt(len(good))
    wide = max(own, scatter)
    return np.array([value, max(value - wide, 0.0), value + wide])


def _interval(row: Array) -> Interval:
    return Interval(*map(float, row))


def _moment(seconds: float) -> datetime:
    return datetime.fromtimestamp(float(seconds), UTC)
