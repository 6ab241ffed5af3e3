"""The picture of a diagnosis, with Matplotlib and no display."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from estimator.diagnosis.coherence import compared_signal
from estimator.diagnosis.oscillation import autocorrelation, band_of
from estimator.window import bridge
from fieldlink.pictures import MARK, MODEL, OP, PV, STEM

if TYPE_CHECKING:
    from fieldlink.diagnosing import Plant
    from fieldlink.diagnosis import Diagnosis, Group, LoopSignals
    from fieldlink.site.recording import Recording

__all__ = ["diagnosis_figure", "group_figure"]

_PERIODS = 6.0
"""Periods that the autocorrelation is drawn for."""
_GROUP_PERIODS = 12.0
"""Last periods of a group's loops that are drawn."""
_MOST_LOOPS = 12
"""Loops of a group that are drawn, the likeliest sources first."""


def diagnosis_figure(recording: Recording, found: Diagnosis, *, title: str) -> Figure:
    """Draw OP, PV with SP, the oscillation's autocorrelation, and the causes with their weights."""
    figure = Figure(figsize=(12.0, 8.0), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(1.0, 1.0, 1.2))
    t = np.arange(recording.op.size) * recording.period
    upper = figure.add_subplot(grid[0, :])
    lower = figure.add_subplot(grid[1, :], sharex=upper)
    upper.plot(t, recording.op, color=OP, lw=1.0, label="OP")
    has_pv = bool(np.isfinite(recording.pv).any())
    if has_pv:
        lower.plot(t, recording.pv, color=PV, lw=1.0, label="PV")
    if recording.sp is not None:
        lower.plot(t, recording.sp, color=MARK, lw=0.9, ls="--", label="SP")
    upper.set_ylabel("OP")
    lower.set(xlabel="time / s", ylabel="PV")
    for axes in (upper, lower):
        if axes.get_legend_handles_labels()[0]:
            # Above the axes, where it hides no sample.
            axes.legend(
                loc="lower right",
                bbox_to_anchor=(1.0, 1.0),
                borderaxespad=0.2,
                ncols=3,
                fontsize="small",
                frameon=False,
            )
        axes.margins(x=0.0)
    swing = found.oscillation
    left = figure.add_subplot(grid[2, 0])
    left.set(xlabel="lag / s", ylabel="autocorrelation", title="oscillation")
    if np.isfinite(swing.period_s):
        signal = recording.op
        if has_pv and found.oscillating != "op":
            is_error = found.oscillating == "error" and recording.sp is not None
            signal = recording.sp - recording.pv if is_error else recording.pv  # type: ignore[operator]
        kept = band_of(bridge(signal), recording.period / swing.period_s)
        lags = autocorrelation(kept)
        shown = min(lags.size // 2, int(_PERIODS * swing.period_s / recording.period))
        left.plot(np.arange(shown) * recording.period, lags[:shown], color=MODEL)
        left.axhline(0.0, color=OP, lw=0.5)
        left.set_title(
            f"{'oscillation' if swing.present else 'no regular oscillation'}: "
            f"{swing.period_s:.4g} s, regularity {swing.regularity:.3g}"
        )
    right = figure.add_subplot(grid[2, 1])
    names = [cause.name.words for cause in found.causes][::-1]
    right.barh(names, [cause.weight for cause in found.causes][::-1], color=STEM)
    right.set(
        xlim=(0.0, 1.0), ylim=(-0.7, max(2.0, len(names) - 0.3)), xlabel="weight", title="causes"
    )
    figure.suptitle(f"{title}: {found.first.name.words}")
    return figure


def group_figure(plant: Plant, group: Group, *, title: str) -> Figure:
    """Draw what the loops of a group swing by, the likeliest source on top."""
    order = [one.loop for one in group.candidates if one.loop is not None][:_MOST_LOOPS]
    weights = {one.loop: one.weight for one in group.candidates}
    figure = Figure(figsize=(12.0, 1.0 + 1.1 * len(order)), layout="constrained")
    many = figure.subplots(len(order), 1, sharex=True, squeeze=False)[:, 0]
    end = max(plant.signals[name].start_s + _length(plant.signals[name]) for name in order)
    begin = end - _GROUP_PERIODS * group.period_s
    for axes, name in zip(many, order, strict=True):
        one = plant.signals[name]
        values = compared_signal(one)
        t = one.start_s + one.period * np.arange(values.size)
        shown = t >= begin
        axes.plot(t[shown] - begin, values[shown], color=STEM if name == order[0] else PV, lw=1.0)
        axes.set_ylabel(f"{name}\n{weights[name]:.0%}", rotation=0, ha="right", va="center")
        axes.margins(x=0.0)
    many[-1].set_xlabel("time / s")
    outside = weights.get(None, 0.0)
    figure.suptitle(
        f"{title}: control errors of {len(group.loops)} loops that swing together, "
        f"{group.period_s:.4g} s; source outside of them: {outside:.0%}"
    )
    return figure


def _length(one: LoopSignals) -> float:
    return one.period * one.op.size
