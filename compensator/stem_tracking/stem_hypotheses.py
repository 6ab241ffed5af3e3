"""Hypotheses on the stem: the first ones, what a command makes of each, which are kept."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from compensator.prediction import Prediction
from compensator.stem_tracking.belief import Belief
from compensator.stem_tracking.tracker_settings import TrackerSettings
from loop_model import ValveModel

__all__ = ["first_beliefs", "likely_ones", "outcomes_of", "recalled_ones"]


def first_beliefs(
    prediction: Prediction, pv: float, op: float, valve: ValveModel, settings: TrackerSettings
) -> list[Belief]:
    """Return the hypotheses of a loop at rest at ``pv``: the stem is anywhere in OP's band."""
    fs = valve.static_friction
    state, drive = prediction.equilibrium(pv, 0.0)
    return [
        Belief(
            op + offset * fs,
            0.0,
            state.copy(),
            np.array([drive - op - offset * fs, 0.0, settings.gain - 1.0]),
            score=-0.5 * abs(offset),
        )
        for offset in (settings.first if fs > 0.0 else (0.0,))
    ]


def outcomes_of(h: Belief, op: float, valve: ValveModel, settings: TrackerSettings) -> list[Belief]:
    """Return what ``op`` may have made of a hypothesis: the stem stays, or slips, or both."""
    friction, negligible = settings.friction, settings.negligible
    error = op - h.stem
    side = math.copysign(1.0, error)
    z = (abs(error) - valve.static_friction) / friction.static_deviation(valve)
    stays = friction.chance_of_rest(z, h.tested)
    outcomes = []
    if stays > negligible:
        outcomes.append(h.stay(z, math.log(stays), friction))
    if stays < 1.0 - negligible:
        landed = op - side * valve.dynamic_friction
        outcomes.append(h.slip(landed, side, math.log(1.0 - stays), friction))
    return outcomes


def likely_ones(beliefs: list[Belief], settings: TrackerSettings) -> list[Belief]:
    """Return the best few, best first: none hopeless, one of a position.

    The first of ``beliefs`` stays the first while no other is plainly likelier: at rest PV tells
    none from another, and an OP that went from the middle of one band to that of another would set
    off a stem that stands in a third.
    """
    ranked = sorted(beliefs, key=lambda h: -h.score)
    if beliefs[0].score > ranked[0].score - settings.alike:
        ranked.sort(key=lambda h: h is not beliefs[0])
    kept: dict[float, Belief] = {}
    least = ranked[0].score - settings.hopeless
    for h in ranked:
        if h.score < least or len(kept) == settings.hypotheses:
            break
        kept.setdefault(h.stem, h)
    return list(kept.values())


def recalled_ones(
    best: Belief, rests: Iterable[tuple[float, float]], op: float, reach: float, against: float
) -> list[Belief]:
    """Return hypotheses at earlier positions, with the direction of the slip that led there, unless
    ``op`` is farther than ``reach`` from them; ``against`` are the log-odds against each.
    """
    return [
        Belief(
            stem,
            direction,
            best.state.copy(),
            best.errors.copy(),
            best.noise,
            best.score - against,
        )
        for stem, direction in rests
        if abs(stem - best.stem) > 1e-9 and abs(op - stem) <= reach
    ]
