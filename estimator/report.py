"""The last step: everything that was found, as one result in units of OP and PV."""

from __future__ import annotations

import math
from types import MappingProxyType

import numpy as np

from estimator.estimate import Estimate
from estimator.evidence.verdict import Judgement
from estimator.evidence.weighing import Weighing
from estimator.hypotheses.hypothesis import Hypothesis
from estimator.identifiability import dead_time_bound, identifiability
from estimator.outcomes import Reason, Verdict
from estimator.result import CostSurface, Evidence, Fit, Identification, Interval, Process, RunnerUp
from estimator.window import Window
from loop_model import LoopModel, ValveModel

__all__ = ["describe", "unassessed"]


def describe(
    window: Window,
    estimate: Estimate,
    judgement: Judgement,
    evidence: Evidence,
    fit: Fit,
    weighing: Weighing,
    confidence: float,
    longest: int,
    surface: CostSurface | None,
) -> Identification:
    """The result of a window that was judged; ``longest`` is the longest dead time tried."""
    span = window.op_span
    band, jump = estimate.band.scaled(span), estimate.jump.scaled(span)
    return Identification(
        verdict=judgement.verdict,
        uncertain=judgement.uncertain,
        reasons=judgement.reasons,
        score=evidence.log_bayes_factor,
        stick_band=band,
        slip_jump=jump,
        static_friction=estimate.static.scaled(span),
        dynamic_friction=estimate.dynamic.scaled(span),
        confidence=confidence,
        process=estimate.process,
        fit=fit,
        criterion=estimate.criterion,
        evidence=evidence,
        samples=window.size,
        period_s=window.period,
        seconds=0.0,
        model=LoopModel(ValveModel(band.value, min(jump.value, band.value)), estimate.model),
        stem=window.op_centre + span * estimate.stem,
        pv_model=window.pv_centre + window.pv_scale * estimate.simulated,
        surface=surface,
        runners_up=_runners_up(window, weighing),
        identifiability=(
            *identifiability(estimate, span, sticky=judgement.verdict is Verdict.STICTION),
            *dead_time_bound(estimate.process.dead_time_samples, longest),
        ),
        criterion_reason=estimate.reason,
    )


def _runners_up(window: Window, weighing: Weighing) -> tuple[RunnerUp, ...]:
    """The healthy valve and the other laws, by how far they are behind."""
    found: list[tuple[str, Hypothesis]] = [("healthy valve", weighing.healthy)]
    span = window.op_span
    found += [
        (f"sticky valve (law {one.valve.law}), S {span * one.valve.band:.3g}", one)
        for one in weighing.laws
        if one.valve is not None
    ]
    best = max(one.likelihood for _, one in found)
    rest = [
        RunnerUp(name, one.poles.shape.value, one.dead_time, best - one.likelihood)
        for name, one in found
        if one.likelihood < best
    ]
    return tuple(sorted(rest, key=lambda one: one.behind))


def unassessed(
    window: Window, reasons: tuple[Reason, ...], criterion: str, confidence: float
) -> Identification:
    """The result of a window that cannot be judged."""
    unknown = Interval.unknown()
    nothing = np.full(window.size, np.nan)
    nan = math.nan
    return Identification(
        verdict=Verdict.NOT_ASSESSABLE,
        reasons=reasons,
        score=0.0,
        stick_band=unknown,
        slip_jump=unknown,
        static_friction=unknown,
        dynamic_friction=unknown,
        confidence=confidence,
        process=Process("none", MappingProxyType({}), 0, unknown),
        fit=Fit(nan, nan),
        criterion="oe" if criterion == "auto" else criterion,
        evidence=Evidence(nan, nan, nan, nan, nan, 0, 0, 0, 0, nan, nan, 0, "none"),
        samples=window.size,
        period_s=window.period,
        seconds=0.0,
        model=None,
        stem=nothing,
        pv_model=nothing.copy(),
        surface=None,
    )
