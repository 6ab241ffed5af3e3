"""One valve over many windows: S, J and the result of `estimator.track`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks.report import table
from estimator import Identification, Interval, Track, Verdict, track

__all__ = ["Course", "course_of", "plot_course"]


@dataclass(frozen=True, slots=True)
class Course:
    """The results of one loop's windows, in order of time, and their track."""

    results: tuple[Identification, ...]
    track: Track

    def markdown(self) -> str:
        """A table of the windows and a line on changes and trend."""
        band, jump = self.track.stick_band, self.track.slip_jump
        header = ("begun", "verdict", "S", "low", "high", "S, smoothed", "J", "J, smoothed")
        rows = []
        for i, one in enumerate(self.results):
            s, j = one.stick_band, one.slip_jump
            verdict = one.verdict.value + (" (uncertain)" if one.uncertain else "")
            smooth = (float(band.value[i]), float(jump.value[i]))
            rows.append(
                (
                    _date(band.times[i]),
                    verdict,
                    s.value,
                    s.low,
                    s.high,
                    smooth[0],
                    j.value,
                    smooth[1],
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
            "begun": [_date(t) for t in band.times],
            "stick_band": [one.stick_band.to_dict() for one in self.results],
            "stick_band_smoothed": band.value.tolist(),
            "trend_per_day": band.trend_per_day.to_dict(),
            "changes": [
                [change.kind.value, _date(band.times[change.onset])] for change in band.changes
            ],
        }


def _date(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d")


def course_of(begun: Sequence[float], results: Sequence[Identification]) -> Course:
    """Track one loop; ``begun`` are seconds since 1970. Only the verdict stiction gives S and J."""
    order = sorted(range(len(begun)), key=lambda i: begun[i])
    own = tuple(results[i] for i in order)
    sticky = [one.verdict is Verdict.STICTION for one in own]
    unknown = Interval.unknown()
    return Course(
        results=own,
        track=track(
            [begun[i] for i in order],
            [one.stick_band if s else unknown for one, s in zip(own, sticky, strict=True)],
            [one.slip_jump if s else unknown for one, s in zip(own, sticky, strict=True)],
        ),
    )


def plot_course(course: Course, file: Path, truth: Sequence[tuple[float, float]] = ()) -> None:
    """Draw S and J with intervals and their smoothed course into a PNG.

    ``truth`` holds the true S and J of every window, where they are known.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 1, figsize=(7.5, 5.0), sharex=True, layout="constrained")
    for number, (axis, name, series) in enumerate(
        (
            (axes[0], "stick_band", course.track.stick_band),
            (axes[1], "slip_jump", course.track.slip_jump),
        )
    ):
        when = [datetime.fromtimestamp(t, UTC) for t in series.times]
        each = [getattr(one, name) for one in course.results]
        value = [one.value for one in each]
        error = [
            [max(0.0, one.value - one.low) for one in each],
            [max(0.0, one.high - one.value) for one in each],
        ]
        axis.errorbar(when, value, yerr=error, fmt="o", ms=4, capsize=3, label="window, 90 %")
        axis.plot(when, series.value, label="smoothed")
        axis.fill_between(when, series.low, series.high, alpha=0.2)
        if truth:
            axis.plot(when, [pair[number] for pair in truth], "k--", lw=1, label="true")
        axis.set_ylabel(f"{'S' if name == 'stick_band' else 'J'}, % of OP")
        axis.set_ylim(bottom=0.0)
    axes[0].legend(loc="upper left")
    figure.autofmt_xdate()
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)
    pyplot.close(figure)
