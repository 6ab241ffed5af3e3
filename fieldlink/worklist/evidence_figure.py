"""The picture on a loop's page of evidence: what the window shows, and S over weeks."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from fieldlink.pictures import MARK, OP, PV, STEM
from fieldlink.worklist.from_store import ReportedLoop
from fieldlink.worklist.settings import WorkListSettings

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_evidence", "evidence_png", "evidence_svg"]

_SETTINGS = WorkListSettings()
_DAY = 86400.0


def evidence_svg(loop: ReportedLoop, number: int) -> str:
    """Return the picture as an SVG element; ``number`` tells it from others of the page.

    Text stays text, in the page's own letters: the element is small and its words can be found.
    """
    buffer = io.StringIO()
    figure = draw_evidence(loop)
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": f"evidence-{number}"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    element = text[text.index("<svg") :]
    # A title and a size of its own, so that a reader that speaks and a narrow page can use it.
    words = f"OP, estimated stem, PV and course of the stick band of {loop.row.tag}"
    return re.sub(r"<svg ", f'<svg role="img" aria-label="{_escaped(words)}" ', element, count=1)


def evidence_png(loop: ReportedLoop) -> bytes:
    """Return the picture as a PNG file for paper."""
    buffer = io.BytesIO()
    draw_evidence(loop).savefig(buffer, format="png", dpi=120)
    return buffer.getvalue()


def draw_evidence(loop: ReportedLoop) -> Figure:
    """Draw OP with the stem, PV with SP, PV over OP, and S over time with limit and repair."""
    figure = Figure(figsize=(11.0, 3.4))
    has_course = loop.course is not None and len(loop.course) > 1
    widths = (1.5, 0.75, 1.0) if has_course else (1.5, 0.75)
    grid = figure.add_gridspec(
        2, len(widths), width_ratios=widths, left=0.055, right=0.99, top=0.9, bottom=0.14,
        hspace=0.18, wspace=0.26,
    )  # fmt: skip
    upper = figure.add_subplot(grid[0, 0])
    lower = figure.add_subplot(grid[1, 0], sharex=upper)
    across = figure.add_subplot(grid[:, 1])
    _draw_window(upper, lower, across, loop)
    if has_course:
        _draw_course(figure.add_subplot(grid[:, 2]), loop)
    for axes in figure.axes:
        axes.tick_params(labelsize=8)
    return figure


def _draw_window(upper: Axes, lower: Axes, across: Axes, loop: ReportedLoop) -> None:
    samples = loop.samples
    upper.tick_params(labelbottom=False)
    if samples is None:
        for axes in (upper, lower, across):
            axes.text(0.5, 0.5, "samples are no longer kept", ha="center", transform=axes.transAxes)
        return
    n = samples.op.size
    rows = slice(max(0, n - _SETTINGS.picture_samples), n)
    time = np.arange(n)[rows] * samples.period
    unit, scale = ("h", 3600.0) if np.ptp(time) > 7200.0 else ("min", 60.0)
    time = (time - time[-1]) / scale
    upper.plot(time, samples.op[rows], color=OP, lw=0.9, label="OP")
    if samples.stem is not None:
        upper.plot(time, samples.stem[rows], color=STEM, lw=1.1, label="stem (estimated)")
    lower.plot(time, samples.pv[rows], color=PV, lw=0.9, label="PV")
    if samples.sp is not None:
        lower.plot(time, samples.sp[rows], color=MARK, lw=0.9, ls="--", label="SP")
    for axes in (upper, lower):
        axes.margins(x=0.0)
        _add_legend(axes)
    upper.set_ylabel("OP", fontsize=8)
    lower.set_ylabel("PV", fontsize=8)
    lower.set_xlabel(f"time before the end of the window / {unit}", fontsize=8)
    across.plot(samples.op[rows], samples.pv[rows], color=OP, lw=0.6, label="over OP")
    if samples.stem is not None:
        stem, pv = samples.stem[rows], samples.pv[rows]
        across.plot(stem, pv, color=STEM, lw=0, marker=".", ms=2, label="over stem")
    across.set_xlabel("OP, stem", fontsize=8)
    across.set_ylabel("PV", fontsize=8)
    _add_legend(across)


def _draw_course(axes: Axes, loop: ReportedLoop) -> None:
    course = loop.course
    assert course is not None
    shown = course.combined()
    when = np.asarray(shown.times) / _DAY  # Matplotlib's dates: days since 1970
    value, low, high = shown.stick_band.T
    known = np.isfinite(value)
    axes.errorbar(
        when[known], value[known], yerr=[value[known] - low[known], high[known] - value[known]],
        fmt="o", ms=3, lw=0.8, color=STEM, label="sticks",
    )  # fmt: skip
    for verdict, marker, colour, words in (
        ("no_stiction", "s", MARK, "does not stick"),
        ("not_assessable", "x", OP, "not judged"),
    ):
        those = when[[v == verdict for v in shown.verdicts]]
        if those.size:
            axes.plot(those, np.zeros(len(those)), marker, ms=3.5, ls="", color=colour, label=words)
    axes.axhline(loop.row.limit, color="black", lw=0.9, ls=":", label="limit")
    if loop.row.repair is not None:
        at = loop.row.repair.time.timestamp() / _DAY
        axes.axvline(at, color=MARK, lw=1.2, ls="--", label="repair")
    axes.set_ylim(bottom=-0.04 * axes.get_ylim()[1])
    axes.set_ylabel("stick band S / % of OP's span", fontsize=8)
    locator = AutoDateLocator(minticks=3, maxticks=6)  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    _add_legend(axes)


def _add_legend(axes: Axes) -> None:
    """Put a legend above the axes, where it hides nothing."""
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 0.97),
        ncols=5,
        fontsize=7,
        frameon=False,
        handletextpad=0.3,
        columnspacing=0.8,
    )


def _escaped(text: str) -> str:
    import html

    return html.escape(text, quote=True)
