"""The report of a rehearsal: one HTML file that needs no network, and its picture as a PNG."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import jinja2
import numpy as np
from matplotlib.figure import Figure

from estimator import Interval
from fieldlink.lab.rehearse.briefing import (
    describe_scene,
    find_unit,
    list_findings,
    list_site_work,
)
from fieldlink.lab.rehearse.errors import ScenarioError
from fieldlink.lab.rehearse.outcome import RunCourse, Window
from fieldlink.pictures import MARK, MODEL, OP, PV, STEM, save, svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from fieldlink.lab.rehearse.run import Rehearsal

__all__ = ["rehearsal_figure", "write_report"]

_VERDICTS = {
    "stiction": (STEM, "stiction"),
    "no_stiction": (MARK, "no stiction"),
    "not_assessable": (MODEL, "not assessable"),
    "": (OP, "refused"),
}


def write_report(rehearsal: Rehearsal, folder: Path) -> Path:
    """Write ``report.html``, ``rehearsal.png`` and the site that was run; return the first.

    Raises:
        ScenarioError, PictureError: a file cannot be written.
    """
    unit = find_unit(rehearsal.file)
    title = rehearsal.file.scenario.scenario.title
    figure = rehearsal_figure(rehearsal.course, title=title, unit=unit)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("fieldlink.lab.rehearse"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
    )
    summary = rehearsal.file.scenario.scenario
    now = f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"
    good = sum(finding.passed for finding in rehearsal.findings)
    page = environment.get_template("report.html.j2").render(
        title=summary.title,
        text=summary.text.strip(),
        subtitle=f"fieldlink rehearse {rehearsal.file.name}, {now}",
        passed=rehearsal.passed,
        outcome=f"{good} of {len(rehearsal.findings)} expectations are met, in "
        f"{summary.duration:g} plant seconds",
        defect=None if rehearsal.defect is None else rehearsal.defect.text,
        scene=describe_scene(rehearsal.file),
        results=list_findings(rehearsal, unit),
        site_work=list_site_work(rehearsal),
        findings=rehearsal.findings,
        figure=svg(figure),
        windows=[_row(window) for window in rehearsal.course.windows],
        writebacks=_writes(rehearsal.course),
        events=[(f"{e.utc_ms / 1000.0:g}", e.kind, e.message) for e in rehearsal.course.events],
        scenario_text=rehearsal.file.path.read_text("utf-8"),
        site_text=rehearsal.site_text,
    )
    report = folder / "report.html"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        report.write_text(page, "utf-8")
        (folder / "site.toml").write_text(rehearsal.site_text, "utf-8")
    except OSError as error:
        raise ScenarioError(
            f"{folder}: the report cannot be written ({error.strerror or error}); name a writable "
            "folder with --report"
        ) from error
    save(figure, folder / "rehearsal.png")
    return report


def rehearsal_figure(course: RunCourse, *, title: str, unit: str = "") -> Figure:
    """Draw OP and stem, PV and SP, and the stick band with the estimate of every window.

    Args:
        course: the run.
        title: over the picture.
        unit: of PV, empty where it has none.
    """
    trend = course.trend
    figure = Figure(figsize=(12.0, 8.5), layout="constrained")
    upper, middle, lower = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.0, 1.1))
    upper.plot(trend.time, trend.op, color=OP, lw=0.8, label="OP")
    upper.plot(trend.time, trend.stem, color=STEM, lw=0.9, label="stem (true)")
    upper.set_ylabel("OP, stem / %")
    if not np.array_equal(trend.pv, trend.measured):
        middle.plot(trend.time, trend.pv, color=MODEL, lw=0.8, label="PV (true)")
    middle.plot(trend.time, trend.measured, color=PV, lw=0.8, label="PV (measured)")
    middle.plot(trend.time, trend.sp, color=MARK, lw=0.9, ls="--", label="SP")
    middle.set_ylabel(f"PV, SP / {unit}" if unit else "PV, SP")
    lower.plot(trend.time, trend.stick_band, color=OP, lw=1.4, label="stick band S (true)")
    _draw_windows(lower, course.windows)
    lower.set(xlabel="plant time / s", ylabel="stick band S / % of OP")
    for axes in (upper, middle, lower):
        _shade(axes, course)
        axes.margins(x=0.0)
        low, high = axes.get_ylim()
        axes.set_ylim(top=high + 0.2 * (high - low))  # room for the legend
        axes.legend(loc="upper left", ncols=5, fontsize="small")
    figure.suptitle(title)
    return figure


def _draw_windows(axes: Axes, windows: tuple[Window, ...]) -> None:
    said: set[str] = set()
    for window in windows:
        colour, words = _VERDICTS[window.verdict]
        label = None if words in said else words
        said.add(words)
        found = window.stick_band
        if window.verdict == "stiction" and math.isfinite(found.value):
            spread = [[found.value - found.low], [found.high - found.value]]
            axes.errorbar(
                window.end, found.value, yerr=spread, fmt="o", ms=5, color=colour, label=label
            )
            axes.hlines(found.value, window.begin, window.end, color=colour, lw=0.8, alpha=0.5)
        else:
            axes.plot(window.end, 0.0, marker="s", ms=6, ls="none", color=colour, label=label)
    axes.set_ylim(bottom=-0.5)


def _shade(axes: Axes, course: RunCourse) -> None:
    """Mark the time in which the compensator has the loop."""
    taken = np.concatenate([[False], course.trend.compensated, [False]])
    edges = np.flatnonzero(taken[1:] != taken[:-1])
    times = np.append(course.trend.time, course.trend.time[-1])
    for number, (begin, end) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        label = "compensated" if number == 0 else None
        axes.axvspan(times[begin], times[end], color=MARK, alpha=0.09, lw=0.0, label=label)


def _writes(course: RunCourse) -> list[tuple[str, ...]]:
    """Return a row for each outcome; what repeats itself without a block between is one row."""
    rows: list[tuple[str, ...]] = []
    runs: dict[tuple[str, ...], list[float]] = {}

    def put_down() -> None:
        for key, times in runs.items():
            often = "" if len(times) == 1 else f" to {times[-1]:g}, {len(times)} times"
            rows.append((f"{times[0]:g}{often}", *key))
        runs.clear()

    for r in course.writebacks:
        if r.outcome in ("committed", "accepted"):
            put_down()
        key = (r.outcome, r.status or "-", _number(r.stick_band), r.reason)
        runs.setdefault(key, []).append(r.utc_ms / 1000.0)
    put_down()
    return rows


def _row(window: Window) -> tuple[str, ...]:
    S, J = window.stick_band, window.slip_jump
    return (
        f"{window.begin:g} to {window.end:g}",
        _VERDICTS[window.verdict][1],
        *(_range(i) for i in (S, J)),
        window.reasons,
    )


def _range(found: Interval) -> str:
    if not math.isfinite(found.value):
        return "-"
    return f"{_number(found.value)} ({_number(found.low)} to {_number(found.high)})"


def _number(value: float | None) -> str:
    return f"{value:.3g}" if value is not None and math.isfinite(value) else "-"
