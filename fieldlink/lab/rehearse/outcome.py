"""What happened in a rehearsal, as the judges and the pictures read it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from estimator import Interval, Track, track
from fieldlink.daemon.windows.loop_counts import LoopCounts
from fieldlink.lab.rehearse.simulated_site import Trend
from fieldlink.store import EstimateRecord, EventRecord, WritebackRecord

__all__ = ["RunCourse", "Window", "track_of"]

_STICK_NOT = (Interval(0.0, 0.0, 0.2), Interval(0.0, 0.0, 0.2))
"""S and J of a valve that was called healthy, in percent of OP: none worth a name."""


@dataclass(frozen=True, slots=True)
class Window:
    """What the daemon made of one window, with the time that it covers.

    Attributes:
        begin, end: plant seconds from its first sample to the end of its last.
        verdict: empty when the estimator refused the window; ``reasons`` then says why.
        stick_band, slip_jump: S and J with intervals, NaN where unknown.
    """

    begin: float
    end: float
    verdict: str
    reasons: str
    score: float
    stick_band: Interval
    slip_jump: Interval

    @classmethod
    def of(cls, record: EstimateRecord, period: float, offset: int) -> Window:
        """Take over a record; ``offset`` is the slot of plant second 0."""
        return cls(
            begin=(record.first_slot - offset) * period,
            end=(record.last_slot - offset + 1) * period,
            verdict=record.verdict or "",
            reasons=record.message,
            score=_number(record.score),
            stick_band=_interval(record.stick_band, record.stick_band_low, record.stick_band_high),
            slip_jump=_interval(record.slip_jump, record.slip_jump_low, record.slip_jump_high),
        )

    def to_dict(self) -> dict[str, object]:
        """Plain types, null for no number."""
        return {
            "begin": self.begin,
            "end": self.end,
            "verdict": self.verdict,
            "reasons": self.reasons,
            "stick_band": self.stick_band.to_dict(),
            "slip_jump": self.slip_jump.to_dict(),
        }


@dataclass(frozen=True, eq=False)
class RunCourse:
    """A run from its beginning to its end.

    Attributes:
        trend: true values, scan by scan.
        windows: the daemon's results, in order.
        writebacks, events: the daemon's records, in order.
        counts: of the samples, by outcome.
        track: S and J over the windows that tell them; None without any.
    """

    trend: Trend
    windows: tuple[Window, ...]
    writebacks: tuple[WritebackRecord, ...]
    events: tuple[EventRecord, ...]
    counts: LoopCounts
    track: Track | None


def track_of(windows: Sequence[Window]) -> Track | None:
    """Follow S and J over the windows that tell both; None without any.

    A window without stiction counts as such: what S would be if the valve did stick is not a course
    of a valve that does not.
    """
    told = [
        (window.end, *_STICK_NOT)
        if window.verdict == "no_stiction"
        else (window.end, window.stick_band, window.slip_jump)
        for window in windows
    ]
    known = [(end, S, J) for end, S, J in told if _is_known(S) and _is_known(J)]
    if not known:
        return None
    return track(*(list(column) for column in zip(*known, strict=True)))


def _is_known(interval: Interval) -> bool:
    return all(math.isfinite(x) for x in (interval.value, interval.low, interval.high))


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _interval(value: float | None, low: float | None, high: float | None) -> Interval:
    return Interval(_number(value), _number(low), _number(high))
