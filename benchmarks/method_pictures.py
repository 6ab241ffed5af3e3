"""Pictures of docs/method.md: what S and J are, what a window says about them, a valve over weeks.

    python -m benchmarks.method_pictures --images docs/images

``valve.png`` is He's valve under a made-up OP. ``likelihood.png`` shows how probable stick bands
are in two windows of the paper's Example 2, with set-point changes and at constant set-point.
``valve-course.png`` is a simulated valve that wears and is repaired, with a window a week.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.examples import EXAMPLES, example_window
from benchmarks.valve_course import course_of, plot_course
from estimator import identify
from estimator.controller.reading import read_aligned
from estimator.evidence.sign import gain_sign
from estimator.evidence.weighing import weigh
from estimator.hypotheses.hypothesis import Case
from estimator.intervals.posterior import Posterior, sample_posterior
from estimator.rows import rows_of
from estimator.settings import SETTINGS
from estimator.valves import HeValve
from estimator.window import harmonise
from loop_model import ValveModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["main"]

_BAND, _JUMP = 4.0, 1.5
_SEED = 0
"""Window of Example 2 whose likelihood is drawn."""

_WEEK = 7 * 86400.0
_BEGUN = 1.7e9
"""Seconds since 1970 of the first window: November 2023."""
_WEEKS = 16
_REPAIRED = 11
"""Window with which the repaired valve begins."""


def _valve(axes: Axes) -> None:
    k = np.arange(240)
    op = 50.0 + 5.0 * np.sin(k / 32.0)
    stem = HeValve(_BAND, _JUMP).simulate(op, float(op[0]))
    axes.plot(k, op, color="tab:blue", label="OP")
    axes.step(k, stem, where="post", color="tab:red", label="stem")
    moved = np.flatnonzero(np.diff(stem)) + 1
    up = moved[stem[moved] > stem[moved - 1]]
    turn = moved[(moved > up[-1]) | (stem[moved] < stem[moved - 1])][0]
    last = up[up < turn][-1]
    for low, high, at, name in (
        (op[turn], op[last], turn + 4, "S"),
        (op[up[up < turn][-2]], op[last], last - 4, "J"),
    ):
        axes.annotate("", (at, low), (at, high), arrowprops={"arrowstyle": "<->"})
        axes.text(at + 2, 0.5 * (low + high), name, va="center", weight="bold")
        axes.hlines([low, high], at - 12, at + 3, color="0.6", lw=0.8)
    axes.set(xlabel="sample", ylabel="percent", title=f"He's valve, S = {_BAND:g}, J = {_JUMP:g}")
    axes.legend(loc="lower left")


def _posterior(constant: bool) -> tuple[Posterior, float]:
    """What a window of Example 2 says, and the span of OP that its shares are of."""
    recorded = example_window(EXAMPLES[1], _SEED, constant=constant)
    window = harmonise(recorded.op, recorded.pv, None, None, 1.0, SETTINGS.screening)
    exact = read_aligned(recorded.op, recorded.pv, None).controller
    sign = gain_sign(recorded.op, recorded.pv, None, exact, SETTINGS.modelling)
    case = Case(rows_of(window, sign, SETTINGS.modelling), SETTINGS)
    return sample_posterior(case, weigh(case).laws), window.op_span


def _likelihood(axes: Axes, *, constant: bool) -> None:
    posterior, span = _posterior(constant)
    truth = EXAMPLES[1].valve.stick_band
    edges = np.linspace(0.7 * truth, 1.2 * truth, 201)
    # the spread that each gap leaves, as a normal distribution around every sample
    least = edges[1] - edges[0]
    middle = 0.5 * (edges[1:] + edges[:-1])
    density = np.zeros(middle.size)
    for gap in posterior.gaps:
        below, above = (max(span * wide, least) for wide in (gap.below, gap.above))
        away = middle[None, :] - span * posterior.valves[:, 0][:, None]
        shape = np.exp(-0.5 * np.square(away / np.where(away > 0.0, above, below)))
        density += gap.share / (below + above) * (posterior.weights @ shape)
    axes.stairs(density, edges, fill=True, color="tab:blue", alpha=0.6)
    found = posterior.interval(1.0, 0.0, 0.9).scaled(span)
    axes.axvspan(found.low, found.high, color="tab:blue", alpha=0.12, label="90 % interval")
    axes.axvline(truth, color="k", ls="--", lw=1, label="true S")
    axes.set(xlabel="stick band S", yticks=[], xlim=(edges[0], edges[-1]))
    valves = " or ".join(
        f"S {span * peak.band:.2f}, J {span * peak.jump:.2f} ({100 * peak.share:.0f} %)"
        for peak in posterior.peaks()
    )
    where = "constant set-point" if constant else "set-point changes"
    axes.set_title(f"{where}: {valves}", fontsize=9)


def _plot_wear(file: Path) -> None:
    """A valve whose S grows by a quarter percent a week, until it is repaired."""
    grown = [2.0 + 0.25 * week for week in range(_REPAIRED)]
    bands = [*grown, *[1.5] * (_WEEKS - _REPAIRED)]
    truth = [(band, 0.3 * band) for band in bands]
    results = []
    for week, (band, jump) in enumerate(truth):
        example = replace(EXAMPLES[0], valve=ValveModel(band, jump))
        window = example_window(example, week)
        results.append(identify(window.op, window.pv))
    begun = [_BEGUN + week * _WEEK for week in range(_WEEKS)]
    plot_course(course_of(begun, results), file, truth)


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the pictures."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--images", type=Path, required=True, help="folder for the pictures")
    options = parser.parse_args(arguments)
    options.images.mkdir(parents=True, exist_ok=True)
    figure, axes = pyplot.subplots(figsize=(7.0, 3.2), layout="constrained")
    _valve(axes)
    figure.savefig(options.images / "valve.png", dpi=110)
    figure, pair = pyplot.subplots(1, 2, figsize=(9.0, 3.0), layout="constrained")
    for one, constant in zip(pair, (False, True), strict=True):
        _likelihood(one, constant=constant)
    pair[0].set_ylabel("probability")
    pair[0].legend(loc="upper left", fontsize=8)
    figure.savefig(options.images / "likelihood.png", dpi=110)
    pyplot.close("all")
    _plot_wear(options.images / "valve-course.png")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
