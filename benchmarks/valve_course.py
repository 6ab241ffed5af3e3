"""One valve over many windows: S, J and what `estimator.track` makes of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks.recorded import Judged
from benchmarks.report import table
from estimator import Interval, Track, track

__all__ = ["Course", "course_of", "longest_loop", "plot_course"]

_DAY = 86400.0


@dataclass(frozen=True, slots=True)
class Course:
    """The windows of one loop, in order of time, and their track."""

    loop: str
    windows: tuple[Judged, ...]
    track: Track

    def markdown(self) -> str:
        """A table of the windows and a line on changes and trend."""
        band, jump = self.track.stick_band, self.track.slip_jump
        header = ("begun", "verdict", "S", "low", "high", "S, smoothed", "J", "J, smoothed")
        rows = []
        for i, one in enumerate(self.windows):
            s, j = one.result.stick_band, one.result.slip_jump
            smooth = (float(band.value[i]), float(jump.value[i]))
            rows.append(
                (
                    *(_date(band.times[i]), one.result.verdict.value),
                    *(s.value, s.low, s.high, smooth[0]),
                    *(j.value, smooth[1]),
                )
            )
        slope = band.trend_per_day
        found = ", ".join(f"{c.kind.value} at {_date(band.times[c.onset])}" for c in band.changes)
        month = [30.0 * v for v in (slope.value, slope.low, slope.high)]
        return (
            f"{table(header, rows)}\n\nS changes by {month[0]:.2g} ({month[1]:.2g} to "
            f"{month[2]:.2g}) in 30 days at the end; changes found: {found or 'none'}."
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain types."""
        band = self.track.stick_band
        return {
            "loop": self.loop,
            "begun": [_date(t) for t in band.times],
            "stick_band": [one.result.stick_band.to_dict() for one in self.windows],
            "stick_band_smoothed": band.value.tolist(),
            "trend_per_day": band.trend_per_day.to_dict(),
            "changes": [
                [change.kind.value, _date(band.times[change.onset])] for change in band.changes
            ],
        }


def _date(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d")


def longest_loop(windows: Sequence[Judged]) -> str:
    """The loop with the most windows."""
    return Counter(one.window.loop for one in windows).most_common(1)[0][0]


def course_of(windows: Sequence[Judged], loop: str) -> Course:
    """Track the windows of ``loop``; a window without the verdict stiction says nothing of S."""
    own = [one for one in windows if one.window.loop == loop and one.window.begun is not None]
    own.sort(key=lambda one: one.window.begun or 0.0)
    unknown = Interval(math.nan, math.nan, math.nan)
    sticky = [one.result.verdict.value == "stiction" for one in own]
    return Course(
        loop=loop,
        windows=tuple(own),
        track=track(
            [one.window.begun or 0.0 for one in own],
            [o.result.stick_band if s else unknown for o, s in zip(own, sticky, strict=True)],
            [o.result.slip_jump if s else unknown for o, s in zip(own, sticky, strict=True)],
        ),
    )


def plot_course(course: Course, file: Path) -> None:
    """Draw S and J with intervals and their smoothed course into a PNG."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 1, figsize=(7.5, 5.0), sharex=True, layout="constrained")
    for axis, name, series in (
        (axes[0], "stick_band", course.track.stick_band),
        (axes[1], "slip_jump", course.track.slip_jump),
    ):
        when = [datetime.fromtimestamp(t, UTC) for t in series.times]
        each = [getattr(one.result, name) for one in course.windows]
        value = [one.value for one in each]
        error = [
            [max(0.0, one.value - one.low) for one in each],
            [max(0.0, one.high - one.value) for one in each],
        ]
        axis.errorbar(when, value, yerr=error, fmt="o", ms=4, capsize=3, label="window, 90 %")
        axis.plot(when, series.value, label="smoothed")
        axis.fill_between(when, series.low, series.high, alpha=0.2)
        axis.set_ylabel(f"{'S' if name == 'stick_band' else 'J'}, % of OP")
        axis.set_ylim(bottom=0.0)
    axes[0].legend(loc="lower left")
    figure.autofmt_xdate()
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)
    pyplot.close(figure)
