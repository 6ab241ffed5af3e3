"""Pictures of the compensation benchmark: the paper's Figure 3, deviation against travel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.compensation_cases import (
    CASES,
    WARM,
    Case,
    figures_of,
    held,
    limits_of,
    model_of,
    play,
)
from benchmarks.compensation_verdicts import dominated
from fieldlink.lab.study.controllers import Setup
from fieldlink.pictures import OP, PV, STEM

__all__ = ["draw_figure3", "draw_points", "draw_tradeoff"]

SWEEPS: dict[str, Sequence[float]] = {
    "pi": (0.5, 1.0, 2.0, 4.0),
    "unaware": (0.1, 1.0, 10.0, 100.0),
    "hybrid": (0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 4.0),
    "embedding": (0.1, 1.0, 10.0),
    "knocker": (0.7, 1.0, 1.5, 2.5),
    "two-move": (0.25, 0.5, 1.0, 2.0, 4.0),
}
_COLOURS = ("#7f8c8d", "#1f4e79", "#c0392b", "#e08e0b", "#2e7d32", "#8e44ad")
_SEED = 1
_SEEDS = (1, 2)


def draw_figure3(folder: Path | None, *, embedding: bool) -> str:
    """Draw Example 2 under two set-point steps: unaware, embedding, hybrid; identified parameters.

    Returns words on the parameters used. Source: Figure 3 of Bacci di Capaci et al., 2018.
    """
    case = CASES[1]
    process, limits = case.model.process, limits_of(case)
    unaware, _ = play(case, "unaware", Setup(process, case.model, limits), _SEED)
    model, words = model_of(case, unaware, "identified")
    if model is None:
        model, words = case.model, f"exact parameters (the window was judged {words})"
    setup = Setup(process, model, limits)
    names = ["unaware", "embedding", "hybrid"] if embedding else ["unaware", "hybrid"]
    figure = Figure(figsize=(12.0, 7.5), layout="constrained")
    axes = figure.subplots(2, len(names), sharex=True, sharey="row")
    begin = WARM - 100
    for column, name in enumerate(names):
        trace = unaware if name == "unaware" else play(case, name, setup, _SEED)[0]
        t = np.arange(begin, trace.pv.size) - WARM
        upper, lower = axes[0, column], axes[1, column]
        upper.plot(t, trace.pv[begin:], color=PV, lw=1.0, label="PV")
        upper.plot(t, trace.sp[begin:], color="black", lw=0.9, ls="--", label="SP")
        lower.plot(t, trace.op[begin:], color=OP, lw=0.9, label="OP")
        lower.plot(t, trace.stem[begin:], color=STEM, lw=1.2, label="stem")
        upper.set_title(name)
        lower.set_xlabel("samples from take-over")
        for one in (upper, lower):
            one.axvline(0.0, color="black", lw=0.6)
            one.margins(x=0.0)
            one.legend(loc="upper right", fontsize="small")
    figure.suptitle(f"Example 2 (Figure 3 of the paper): {words}")
    if folder is not None:
        figure.savefig(folder / "figure3.png", dpi=100)
    return words


def draw_tradeoff(
    folder: Path | None, *, embedding: bool
) -> tuple[list[dict[str, Any]], list[str]]:
    """Draw PV's deviation from SP against valve travel, sweeping what trades one for the other.

    Exact parameters, Examples 1 and 2, figures over several seeds. Returns the points, and words on
    those of other controllers that lie below the hybrid's curve.
    """
    points: list[dict[str, Any]] = []
    for case in CASES[:2]:
        for name, weights in SWEEPS.items():
            for weight in weights if embedding or name != "embedding" else ():
                travel, rms = _swept(case, name, weight)
                known = {"loop": case.name, "controller": name, "weight": weight}
                points.append({**known, "pv_rms": rms, "travel": travel})
    if folder is not None:
        draw_points(points).savefig(folder / "compensation_tradeoff.png", dpi=100)
    below = [
        f"{case.name}, {words}"
        for case in CASES[:2]
        for words in dominated(_curves(points, case), "hybrid")
    ]
    return points, below


def _curves(
    points: Sequence[Mapping[str, Any]], case: Case
) -> dict[str, list[tuple[float, float]]]:
    curves: dict[str, list[tuple[float, float]]] = {}
    for point in points:
        if point["loop"] == case.name:
            one = (point["travel"], point["pv_rms"])
            curves.setdefault(point["controller"], []).append(one)
    return curves


def draw_points(points: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw the points of a sweep; a line joins those of a controller that none of its own beats."""
    figure = Figure(figsize=(12.0, 5.5), layout="constrained")
    axes = figure.subplots(1, 2)
    colours = dict(zip(SWEEPS, _COLOURS, strict=True))
    for column, case in enumerate(CASES[:2]):
        for name, curve in _curves(points, case).items():
            front = [
                (x, y)
                for x, y in sorted(curve)
                if not any(a <= x and b <= y and (a, b) != (x, y) for a, b in curve)
            ]
            axes[column].plot(*zip(*curve, strict=True), "o", color=colours[name], ms=4)
            axes[column].plot(
                *zip(*front, strict=True), "o-", color=colours[name], ms=4, lw=1.2, label=name
            )
        noise = float(np.sqrt(np.mean([held(case, seed) ** 2 for seed in _SEEDS])))
        axes[column].axhline(noise, color="black", lw=0.8, ls=":", label="stem held")
        axes[column].set(
            title=case.name,
            xlabel="valve travel per 100 samples",
            ylabel="root mean square of PV - SP",
            yscale="log",
            xscale="symlog",
        )
        axes[column].set_xlim(left=-0.2)
        axes[column].legend(fontsize="small")
    return figure


def _swept(case: Case, name: str, weight: float) -> tuple[float, float]:
    """Return travel and root mean square of a controller with a weight, over the seeds."""
    setup = Setup(case.model.process, case.model, limits_of(case), weight)
    found = [
        figures_of(case, play(case, name, setup, seed, watched=False)[0], seed) for seed in _SEEDS
    ]
    rms = float(np.sqrt(np.mean([one.pv_rms**2 for one in found])))
    return float(np.mean([one.travel for one in found])), rms
