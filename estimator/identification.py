"""One window in, one :class:`Identification` out: the order of the steps, and nothing else."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from estimator._kernels import Array
from estimator.conversion import process_description, process_model
from estimator.noise import effective_samples
from estimator.outcomes import EstimatorError, Reason, Verdict
from estimator.profile import Profile, likelihood_profile, quantile_interval
from estimator.regression import Regression
from estimator.result import CostSurface, Evidence, Fit, Identification, Interval, Process
from estimator.search import Candidate, healthy_search, stem_of, valve_search
from estimator.verdict import judge
from estimator.window import Window, harmonise, screen
from loop_model import LoopModel, ValveModel

__all__ = ["CRITERIA", "identify", "warm_up"]

CRITERIA = ("auto", "oe", "arx")
"""Criteria that :func:`identify` knows."""

_SURFACE_NODES = 25


def identify(
    op: ArrayLike,
    pv: ArrayLike,
    *,
    sp: ArrayLike | None = None,
    auto: ArrayLike | None = None,
    period: float = 1.0,
    criterion: str = "auto",
    confidence: float = 0.9,
) -> Identification:
    """Judge the valve of one loop from one window of OP and PV.

    Args:
        op: controller output, shape ``(n,)``; NaN marks a bad sample.
        pv: process variable, shape ``(n,)``, same scans as ``op``; NaN marks a bad sample.
        sp: set-point, shape ``(n,)``, optional.
        auto: non-zero where the controller is in automatic, shape ``(n,)``, optional.
        period: seconds between samples.
        criterion: ``"oe"`` (simulation error), ``"arx"`` (one-step-ahead, the paper's (12)) or
            ``"auto"``.
        confidence: of the intervals, between 0.5 and 0.999.

    Returns:
        The result; :meth:`Identification.to_dict` is its JSON form. A window that cannot be judged
        is a result too (``not_assessable`` with reasons), not an error.

    Raises:
        EstimatorError: not a window at all (shapes, types, no finite sample, unknown option).
    """
    begun = time.perf_counter()
    if criterion not in CRITERIA:
        raise EstimatorError(f"criterion is {criterion!r}: choose one of {', '.join(CRITERIA)}")
    if not 0.5 <= confidence <= 0.999:
        raise EstimatorError(f"confidence is {confidence!r}: give a share from 0.5 to 0.999")
    window = harmonise(op, pv, sp, auto, period)
    reasons = screen(window)
    if reasons:
        result = _not_assessable(window, reasons, criterion, confidence)
    else:
        result = _assess(window, confidence)
    return replace(result, seconds=time.perf_counter() - begun)


def warm_up() -> None:
    """Load or compile the kernels, so that the first window does not wait for them."""
    k = np.arange(200.0)
    identify(np.sin(k / 9.0), np.sin(k / 9.0 - 0.3))


def _assess(window: Window, confidence: float) -> Identification:
    regression = Regression(window.y, window.good)
    healthy = healthy_search(window.u, regression)
    best = valve_search(window.u, regression)[0]
    stem = _stem(window.u, best)
    fit = regression.solve(stem, best.structure, best.dead_time)
    healthy_fit = regression.solve(window.u, healthy.structure, healthy.dead_time)
    samples = min(
        effective_samples(fit.residual, regression.weight),
        effective_samples(healthy_fit.residual, regression.weight),
    )
    profile = likelihood_profile(window.u, regression, best, samples)
    best = profile.best
    stem = _stem(window.u, best)
    fit = regression.solve(stem, best.structure, best.dead_time)
    ratio = 0.5 * samples * math.log(max(healthy.cost, best.cost) / best.cost)
    quality = Fit(1.0 - best.cost / regression.total, 1.0 - healthy.cost / regression.total)
    evidence = _evidence(stem, best, ratio, samples)
    score = ratio
    verdict, reasons = judge(score, evidence, quality)
    intervals = _intervals(window, profile, best, confidence)
    model = process_model(window, best.structure, best.dead_time, fit)
    gain = quantile_interval(fit.gain, profile.gain, profile.log_likelihood, confidence)
    return Identification(
        verdict=verdict,
        reasons=reasons,
        score=score,
        stick_band=intervals["S"],
        slip_jump=intervals["J"],
        static_friction=intervals["fS"],
        dynamic_friction=intervals["fD"],
        confidence=confidence,
        process=process_description(window, best.structure, model, gain),
        fit=quality,
        criterion="oe",
        evidence=evidence,
        samples=window.size,
        period_s=window.period,
        seconds=0.0,
        model=LoopModel(
            ValveModel(intervals["S"].value, min(intervals["J"].value, intervals["S"].value)),
            model,
        ),
        stem=window.op_centre + window.op_span * stem,
        pv_model=window.pv_centre + window.pv_scale * fit.prediction,
        surface=_surface(window, regression, best),
    )


def _stem(u: Array, best: Candidate) -> Array:
    one = np.ones(1)
    found: Array = stem_of(u, best.band * one, best.ratio * one, best.start * one)[:, 0]
    return found


def _intervals(
    window: Window, profile: Profile, best: Candidate, confidence: float
) -> dict[str, Interval]:
    band, jump = profile.band, profile.jump
    quantities = {
        "S": (best.band, band),
        "J": (best.jump, jump),
        "fS": (0.5 * (best.band + best.jump), 0.5 * (band + jump)),
        "fD": (0.5 * (best.band - best.jump), 0.5 * (band - jump)),
    }
    return {
        name: quantile_interval(value, nodes, profile.log_likelihood, confidence).scaled(
            window.op_span
        )
        for name, (value, nodes) in quantities.items()
    }


def _evidence(stem: Array, best: Candidate, ratio: float, samples: float) -> Evidence:
    steps = np.diff(stem)
    steps = steps[np.abs(steps) > 1e-9]
    reversals = int((np.sign(steps[1:]) != np.sign(steps[:-1])).sum())
    return Evidence(ratio, samples, int(steps.size), reversals, best.band)


def _surface(window: Window, regression: Regression, best: Candidate) -> CostSurface:
    nodes = np.linspace(0.0, 1.1, _SURFACE_NODES)[1:]
    jumps = np.linspace(0.0, 1.1, _SURFACE_NODES)
    band, jump = (g.ravel() for g in np.meshgrid(nodes, jumps, indexing="ij"))
    inside = jump <= band + 1e-12
    cost = np.full(band.size, np.nan)
    ratio = np.minimum(jump[inside] / band[inside], 1.0)
    least = np.full(ratio.size, np.inf)
    for start in (-0.7, 0.0, 0.7, best.start):
        stem = regression.whiten(stem_of(window.u, band[inside], ratio, np.full(ratio.size, start)))
        found, _ = regression.cost_and_gain(stem, best.structure, best.dead_time)
        least = np.minimum(least, found)
    cost[inside] = least / regression.total
    return CostSurface(
        nodes * window.op_span,
        jumps * window.op_span,
        cost.reshape(nodes.size, jumps.size),
    )


def _not_assessable(
    window: Window, reasons: tuple[Reason, ...], criterion: str, confidence: float
) -> Identification:
    unknown = Interval.unknown()
    nothing = np.full(window.size, np.nan)
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
        fit=Fit(math.nan, math.nan),
        criterion="oe" if criterion == "auto" else criterion,
        evidence=Evidence(0.0, 0.0, 0, 0, 0.0),
        samples=window.size,
        period_s=window.period,
        seconds=0.0,
        model=None,
        stem=nothing,
        pv_model=nothing.copy(),
        surface=None,
    )
