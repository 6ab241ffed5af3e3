"""Pictures of docs/method.md: what S and J are, and what a window says about them.

    python -m benchmarks.method_pictures --images docs/images

``valve.png`` is He's valve under a made-up OP. ``likelihood.png`` shows how probable stick bands
are in two windows of the paper's Example 2: one that a single valve explains, one that two do.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.examples import EXAMPLES, example_window
from estimator._slips import op_of
from estimator.arx import select_orders
from estimator.arx_estimate import arx_posterior
from estimator.arx_search import arx_search
from estimator.exhaustive import one_step_seeds
from estimator.posterior import Posterior
from estimator.valves import HeValve
from estimator.window import harmonise

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["main"]

_BAND, _JUMP = 4.0, 1.5
_SEEDS = (0, 11)
"""Windows of Example 2 with one likely valve and with two."""


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


def _posterior(seed: int) -> tuple[Posterior, float]:
    """What a window of Example 2 says, and the span of OP that its shares are of."""
    recorded = example_window(EXAMPLES[1], seed)
    window = harmonise(recorded.op, recorded.pv, None, None, 1.0)
    op = op_of(window.u)
    seeds = one_step_seeds(op, window.y, window.good, 5)
    healthy = select_orders(window.y, window.good, window.u)[0].bic
    found = arx_search(op, window.y, window.good, seeds, healthy)
    return arx_posterior(window, op, found), window.op_span


def _likelihood(axes: Axes, seed: int) -> None:
    posterior, span = _posterior(seed)
    low, high = span * posterior.low[:, 0], span * posterior.high[:, 0]
    truth = EXAMPLES[1].valve.stick_band
    edges = np.linspace(0.93 * truth, 1.04 * truth, 221)
    # each box spreads its probability evenly over the bins it covers
    inside = np.minimum(high[:, None], edges[1:]) - np.maximum(low[:, None], edges[:-1])
    share = np.maximum(inside, 0.0) / np.maximum(high - low, 1e-12)[:, None]
    axes.stairs(posterior.weight @ share, edges, fill=True, color="tab:blue", alpha=0.6)
    found = posterior.interval(1.0, 0.0, 0.9).scaled(span)
    axes.axvspan(found.low, found.high, color="tab:blue", alpha=0.12, label="90 % interval")
    axes.axvline(truth, color="k", ls="--", lw=1, label="true S")
    axes.set(xlabel="stick band S", yticks=[])
    valves = " or ".join(
        f"S {span * peak.band:.2f}, J {span * peak.jump:.2f} ({100 * peak.share:.0f} %)"
        for peak in posterior.peaks()
    )
    axes.set_title(valves, fontsize=9)


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the pictures."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=Path, required=True, help="folder for the pictures")
    options = parser.parse_args(arguments)
    options.images.mkdir(parents=True, exist_ok=True)
    figure, axes = pyplot.subplots(figsize=(7.0, 3.2), layout="constrained")
    _valve(axes)
    figure.savefig(options.images / "valve.png", dpi=110)
    figure, pair = pyplot.subplots(1, 2, figsize=(9.0, 3.0), layout="constrained")
    for one, seed in zip(pair, _SEEDS, strict=True):
        _likelihood(one, seed)
    pair[0].set_ylabel("probability")
    pair[0].legend(loc="upper left", fontsize=8)
    figure.savefig(options.images / "likelihood.png", dpi=110)
    pyplot.close("all")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
