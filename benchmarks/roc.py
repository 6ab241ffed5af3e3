"""How well a score tells sticky loops from healthy ones: ROC, and thresholds chosen without a loop.

The windows of one loop are alike, so a loop is left out whole: the others choose the threshold, and
the windows of the one left out are judged by it. A loop counts once, however many windows it has.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["LeftOut", "Roc", "auc", "best_threshold", "leave_one_loop_out", "plot_roc", "roc"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Roc:
    """False and true alarms, shares from 0 to 1, as the threshold falls; shape ``(m,)`` each."""

    false_alarms: Array
    true_alarms: Array

    @property
    def area(self) -> float:
        """Area under the curve."""
        return float(np.trapezoid(self.true_alarms, self.false_alarms))


def roc(scores: ArrayLike, sticky: ArrayLike) -> Roc:
    """The curve of ``scores`` against labels ``sticky``, shape ``(n,)`` both; ties move together.

    Raises:
        ValueError: there is no sticky or no healthy window.
    """
    score, label = np.asarray(scores, dtype=np.float64), np.asarray(sticky, dtype=np.bool_)
    if label.all() or not label.any():
        raise ValueError(f"a ROC needs sticky and healthy windows; {label.sum()} of {label.size}")
    levels = np.unique(score)[::-1]
    alarmed = score[None, :] >= levels[:, None]
    true = np.concatenate([[0.0], alarmed[:, label].mean(axis=1)])
    false = np.concatenate([[0.0], alarmed[:, ~label].mean(axis=1)])
    return Roc(false, true)


def auc(scores: ArrayLike, sticky: ArrayLike) -> float:
    """Area under the ROC: how often a sticky window scores above a healthy one, a tie half."""
    return roc(scores, sticky).area


def best_threshold(scores: ArrayLike, sticky: ArrayLike, loops: Sequence[str]) -> float:
    """Threshold with the highest balanced accuracy, every loop weighing one.

    Where a whole gap serves as well, the middle of the widest one on a logarithmic scale, on which
    everything below 1 counts as 1: scores are log Bayes factors.
    """
    score = np.log(np.maximum(np.asarray(scores, dtype=np.float64), 1.0))
    label = np.asarray(sticky, dtype=np.bool_)
    names, index = np.unique(np.asarray(loops), return_inverse=True)
    weight = 1.0 / np.bincount(index, minlength=names.size)[index]
    levels = np.unique(score)
    if levels.size == 1:
        return math.inf
    edges = list(pairwise(levels.tolist()))
    right = []
    for low, high in edges:
        alarm = score >= 0.5 * (low + high)
        parts = [
            float((weight * (alarm == label))[label == side].sum() / weight[label == side].sum())
            for side in (True, False)
        ]
        right.append(round(sum(parts), 9))
    best = [i for i, value in enumerate(right) if value == max(right)]
    low, high = max((edges[i] for i in best), key=lambda edge: edge[1] - edge[0])
    return float(np.exp(0.5 * (low + high)))


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A loop judged by the threshold that all others chose."""

    loop: str
    sticky: bool
    windows: int
    threshold: float
    right: int


def leave_one_loop_out(
    scores: ArrayLike, sticky: ArrayLike, loops: Sequence[str]
) -> tuple[LeftOut, ...]:
    """Every loop in turn, in order of first appearance."""
    score, label = np.asarray(scores, dtype=np.float64), np.asarray(sticky, dtype=np.bool_)
    names = np.asarray(loops)
    found = []
    for loop in dict.fromkeys(loops):
        out = names == loop
        threshold = best_threshold(score[~out], label[~out], names[~out].tolist())
        right = int(((score[out] >= threshold) == label[out]).sum())
        found.append(LeftOut(loop, bool(label[out].any()), int(out.sum()), threshold, right))
    return tuple(found)


def plot_roc(curves: dict[str, Roc], file: Path) -> None:
    """Draw curves, each with its area, into a PNG."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(4.8, 4.4), layout="constrained")
    for (name, curve), style in zip(curves.items(), ("-", "--", ":", "-."), strict=False):
        axes.plot(
            curve.false_alarms,
            curve.true_alarms,
            style,
            drawstyle="steps-post",
            lw=2,
            label=f"{name}: {curve.area:.3f}",
        )
    axes.plot([0, 1], [0, 1], color="0.8", lw=1)
    axes.set(xlabel="healthy windows called sticky", ylabel="sticky windows called sticky")
    axes.set(xlim=(-0.02, 1), ylim=(0, 1.02), title="Area under the curve")
    axes.legend(loc="lower right")
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)
    pyplot.close(figure)
