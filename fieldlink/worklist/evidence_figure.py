"""The picture on a loop's page of evidence: what the window shows, and S over weeks.

A report has hundreds of them, so one figure is drawn again and again with other data, because
setting up axes and ticks takes longer than drawing them, and many pictures are shared out to the
cores. On paper, what is the same in all of them (legends, labels) is drawn once; the others are
drawn over it, with few colours, so that neither writing nor packing them takes long.
"""

from __future__ import annotations

import html
import io
import os
import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import cache
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from PIL import Image

from fieldlink.pictures import MARK, OP, PV, STEM
from fieldlink.worklist.from_store import ReportedLoop
from fieldlink.worklist.settings import WorkListSettings
from fieldlink.worklist.window_samples import WindowSamples

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

__all__ = ["EvidencePictures", "draw_pngs", "draw_svgs"]

T = TypeVar("T")
R = TypeVar("R")

_SETTINGS = WorkListSettings()
_DAY = 86400.0
_SIZE = 8.0
"""Points of the smallest letters."""


WORTH_PROCESSES = 60
"""Pictures from which several processes draw: starting one takes as long as drawing thirty."""

PART = 10
"""Pictures that a process draws in one go: about a second, so that the first ones come early."""

DPI = 120
"""Pixels an inch on paper: letters of eight points are read without effort."""

COLOURS = 128
"""Of a picture on paper: six colours of lines and letters, and their steps to white."""


def draw_svgs(numbered: Sequence[tuple[int, ReportedLoop]]) -> list[str]:
    """Return the pictures as SVG elements of one page, each loop with its number."""
    return list(_share_out(_draw_svg_part, numbered))


def draw_pngs(loops: Sequence[ReportedLoop]) -> Iterator[bytes]:
    """Yield the pictures as PNG files; while one is used, the next ones are being drawn."""
    return _share_out(_draw_png_part, loops)


def _share_out(draw: Callable[[Sequence[T]], list[R]], items: Sequence[T]) -> Iterator[R]:
    """Draw here, or on each core where there is much to draw; yield in order."""
    cores = os.cpu_count() or 1
    if cores < 2 or len(items) < WORTH_PROCESSES:
        yield from draw(items)
        return
    parts = [items[begin : begin + PART] for begin in range(0, len(items), PART)]
    with ProcessPoolExecutor(min(cores, len(parts)), get_context("spawn")) as pool:
        for part in pool.map(draw, parts):
            yield from part


@cache
def _pictures() -> EvidencePictures:
    """The figures of this process: they are set up once, however many parts it draws."""
    return EvidencePictures()


def _draw_svg_part(numbered: Sequence[tuple[int, ReportedLoop]]) -> list[str]:
    return [_pictures().svg(loop, number) for number, loop in numbered]


def _draw_png_part(loops: Sequence[ReportedLoop]) -> list[bytes]:
    return [_pictures().png(loop) for loop in loops]


class EvidencePictures:
    """Draws the pictures of a report, one after the other."""

    def __init__(self) -> None:
        self._canvases: dict[bool, _Canvas] = {}

    def svg(self, loop: ReportedLoop, number: int) -> str:
        """Return the picture as an SVG element; ``number`` tells it from others of the page.

        Text stays text, in the page's own letters: the element is small and its words can be found.
        """
        buffer = io.StringIO()
        figure = self.draw(loop)
        with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": f"evidence-{number}"}):
            figure.savefig(buffer, format="svg", metadata={"Date": None})
        text = buffer.getvalue()
        words = f"OP, estimated stem, PV and course of the stick band of {loop.row.tag}"
        label = f'<svg role="img" aria-label="{html.escape(words)}" '
        return re.sub(r"<svg ", lambda _found: label, text[text.index("<svg") :], count=1)

    def png(self, loop: ReportedLoop) -> bytes:
        """Return the picture as a PNG file for paper."""
        return self._show(loop).png()

    def draw(self, loop: ReportedLoop) -> Figure:
        """Return the figure of a loop; it is another loop's after the next call."""
        return self._show(loop).figure

    def _show(self, loop: ReportedLoop) -> _Canvas:
        has_course = loop.course is not None and len(loop.course) > 1
        if has_course not in self._canvases:
            self._canvases[has_course] = _Canvas(has_course=has_course)
        canvas = self._canvases[has_course]
        canvas.show_window(loop.samples)
        if has_course:
            canvas.show_course(loop)
        return canvas


class _Canvas:
    """The axes with their lines: OP with the stem, PV with SP, PV over OP, and S over time."""

    def __init__(self, *, has_course: bool) -> None:
        self.figure = Figure(figsize=(11.0, 3.4), dpi=DPI)
        self._agg = FigureCanvasAgg(self.figure)
        self._same: Any = None
        widths = (1.5, 0.75, 1.0) if has_course else (1.5, 0.75)
        grid = self.figure.add_gridspec(
            2, len(widths), width_ratios=widths, left=0.055, right=0.99, top=0.91, bottom=0.14,
            hspace=0.22, wspace=0.26,
        )  # fmt: skip
        self._upper = self.figure.add_subplot(grid[0, 0])
        self._lower = self.figure.add_subplot(grid[1, 0])
        self._across = self.figure.add_subplot(grid[:, 1])
        self._op = _line(self._upper, OP, "OP")
        self._stem = _line(self._upper, STEM, "stem (estimated)")
        self._pv = _line(self._lower, PV, "PV")
        self._sp = _line(self._lower, MARK, "SP", "--")
        self._over_op = _line(self._across, OP, "over OP")
        self._over_stem = _points(self._across, STEM, ".", "over stem")
        self._upper.tick_params(labelbottom=False)
        self._upper.set_ylabel("OP")
        self._lower.set_ylabel("PV")
        self._across.set(xlabel="OP, stem", ylabel="PV")
        self._gone = [
            axes.text(0.5, 0.5, "no good samples are kept", ha="center", transform=axes.transAxes)
            for axes in (self._lower, self._across)
        ]
        if has_course:
            self._course = self.figure.add_subplot(grid[:, 2])
            self._sticks = _points(self._course, STEM, "o", "sticks")
            self._intervals = self._course.vlines([], [], [], color=STEM, lw=0.8)
            self._healthy = _points(self._course, MARK, "s", "healthy")
            self._silent = _points(self._course, OP, "x", "not judged")
            self._limit = self._course.axhline(0.0, color="black", lw=0.9, ls=":", label="limit")
            self._repair = self._course.axvline(0.0, color=MARK, lw=1.2, ls="--", label="repair")
            self._course.set_ylabel("stick band S / % of OP's span")
            # With three at least, no steps would do for two to three minutes, hours or days.
            locator = AutoDateLocator(minticks=2, maxticks=5)  # type: ignore[no-untyped-call]
            self._course.xaxis.set_major_locator(locator)
            self._course.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
        for axes in self.figure.axes:
            _finish(axes, dates=has_course and axes is self._course)

    def png(self) -> bytes:
        """Return what is shown as a PNG file."""
        if self._same is None:
            self._same = self._draw_same()
        renderer = self._renderer()
        renderer.clear()
        renderer.restore_region(self._same)
        with self._hidden(self._drawn_once()):
            self.figure.draw(renderer)
        picture = Image.fromarray(np.asarray(renderer.buffer_rgba())).convert("RGB")
        few = picture.quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        buffer = io.BytesIO()
        few.save(buffer, format="PNG", compress_level=1)
        return buffer.getvalue()

    def _draw_same(self) -> Any:
        """Draw what is the same in every picture."""
        renderer = self._renderer()
        renderer.clear()
        others = [artist for axes in self.figure.axes for artist in (*axes.lines, *axes.texts)]
        others += [artist for axes in self.figure.axes for artist in axes.collections]
        others += [axis for axes in self.figure.axes for axis in (axes.xaxis, axes.yaxis)]
        with self._hidden(others):
            self.figure.draw(renderer)
        return renderer.copy_from_bbox(self.figure.bbox)

    def _renderer(self) -> Any:
        return self._agg.get_renderer()  # type: ignore[no-untyped-call]

    def _drawn_once(self) -> list[Artist]:
        found: list[Artist] = [self.figure.patch]
        for axes in self.figure.axes:
            found += [axes.patch, *axes.spines.values()]
            if (legend := axes.get_legend()) is not None:
                found.append(legend)
        return found

    @staticmethod
    @contextmanager
    def _hidden(artists: Sequence[Artist]) -> Iterator[None]:
        seen = [artist for artist in artists if artist.get_visible()]
        for artist in seen:
            artist.set_visible(False)
        try:
            yield
        finally:
            for artist in seen:
                artist.set_visible(True)

    def show_window(self, samples: WindowSamples | None) -> None:
        """Show a window; words instead where its samples are gone."""
        for text in self._gone:
            text.set_visible(samples is None)
        nothing = np.empty(0)
        if samples is None:
            for line in (self._op, self._stem, self._pv, self._sp, self._over_op, self._over_stem):
                line.set_data(nothing, nothing)
            return
        n = samples.op.size
        rows = slice(max(0, n - _SETTINGS.picture_samples), n)
        op, pv = samples.op[rows], samples.pv[rows]
        stem = np.full(op.size, np.nan) if samples.stem is None else samples.stem[rows]
        sp = np.full(op.size, np.nan) if samples.sp is None else samples.sp[rows]
        seconds = (np.arange(op.size) - op.size + 1) * samples.period
        unit, scale = ("h", 3600.0) if np.ptp(seconds) > 7200.0 else ("min", 60.0)
        time = seconds / scale
        self._op.set_data(time, op)
        self._stem.set_data(time, stem)
        self._pv.set_data(time, pv)
        self._sp.set_data(time, sp)
        self._over_op.set_data(op, pv)
        self._over_stem.set_data(stem, pv)
        self._lower.set_xlabel(f"time before the end of the window / {unit}")
        for axes in (self._upper, self._lower):
            axes.set_xlim(time[0], max(time[-1], time[0] + 1e-9))
            _fit(axes, "y")
        _fit(self._across, "x", "y")

    def show_course(self, loop: ReportedLoop) -> None:
        """Show S over time with its limit and the repair."""
        assert loop.course is not None
        course = loop.course.combined()
        when = course.times / _DAY  # Matplotlib's dates: days since 1970
        value, low, high = course.stick_band.T
        known = np.isfinite(value) & np.isfinite(low) & np.isfinite(high)
        self._sticks.set_data(when[known], value[known])
        ends = zip(when[known], low[known], high[known], strict=True)
        self._intervals.set_segments([np.array([(x, a), (x, b)]) for x, a, b in ends])
        for line, verdict in ((self._healthy, "no_stiction"), (self._silent, "not_assessable")):
            there = when[[said == verdict for said in course.verdicts]]
            line.set_data(there, np.zeros(there.size))
        limit, repair = loop.row.limit, loop.row.repair
        self._limit.set_ydata([limit, limit])
        self._repair.set_visible(repair is not None)
        if repair is not None:
            at = repair.time.timestamp() / _DAY
            self._repair.set_xdata([at, at])
        margin = max(0.03 * (when[-1] - when[0]), 1e-6)
        self._course.set_xlim(when[0] - margin, when[-1] + margin)
        top = max([limit, *high[known]])
        self._course.set_ylim(-0.04 * top, 1.08 * top)


def _line(axes: Axes, colour: str, label: str, style: str = "-") -> Any:
    return axes.plot([], [], color=colour, lw=0.9, ls=style, label=label)[0]


def _points(axes: Axes, colour: str, marker: str, label: str) -> Any:
    return axes.plot([], [], color=colour, ls="", marker=marker, ms=3.0, label=label)[0]


def _finish(axes: Axes, *, dates: bool) -> None:
    """Few ticks, small letters, and a legend above the axes, where it hides nothing."""
    if not dates:
        axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.tick_params(labelsize=_SIZE)
    axes.xaxis.label.set_fontsize(_SIZE)
    axes.yaxis.label.set_fontsize(_SIZE)
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.02, 1.0),
        ncols=5,
        fontsize=_SIZE - 1.0,
        frameon=False,
        borderpad=0.0,
        borderaxespad=0.3,
        handlelength=1.2,
        handletextpad=0.3,
        columnspacing=0.7,
    )


def _fit(axes: Axes, *directions: Literal["x", "y"]) -> None:
    axes.relim()
    for direction in directions:
        axes.autoscale(axis=direction)
