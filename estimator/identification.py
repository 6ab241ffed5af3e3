"""One window in, one :class:`Identification` out: the order of the steps, and nothing else."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import ThreadpoolController

from estimator._slips import Op, op_of
from estimator.arx import ArxOrders, select_orders
from estimator.arx_estimate import arx_estimate
from estimator.arx_search import ArxFound, arx_search
from estimator.candidate import Candidate
from estimator.exhaustive import one_step_seeds
from estimator.hypotheses import (
    OneStepTest,
    against_outside,
    healthy_bic,
    one_step_test,
    simulated_test,
)
from estimator.oe_estimate import oe_estimate, simulable
from estimator.outcomes import EstimatorError, Reason, ReasonCode, Verdict
from estimator.outside import outside_search
from estimator.published import METHODS, published_estimate
from estimator.regression import Regression
from estimator.result import Evidence, Fit, Identification, Interval, Process
from estimator.search import (
    HOPELESS,
    adopted,
    healthy_search,
    restructured,
    shortened,
    shortest,
    valve_search,
)
from estimator.surface import cost_surface
from estimator.verdict import evidence_of, judge, score_of
from estimator.window import Window, harmonise, screen
from estimator.words import TIE, criterion_reason, identifiability
from loop_model import LoopModel, ValveModel

__all__ = ["CRITERIA", "METHODS", "identify", "warm_up"]

CRITERIA = ("auto", "oe", "arx")
"""Criteria that :func:`identify` knows."""

_SEEDS = 5
_PLAIN = 0.05
"""BIC per sample from which on whitened simulation errors are so much better than one-step errors
that the one-step criterion's valve is the simulation's too."""
_SAME = 0.05
"""Stick bands within this share of each other are one valve."""
_FAR_LATER = 3
"""Samples of dead time that neither criterion's refinement takes off by itself."""
_CLEAR = 12.0
"""Log Bayes factor of a sticky valve from which no search is needed to make it likelier."""
_BLAS = ThreadpoolController()


def identify(
    op: ArrayLike,
    pv: ArrayLike,
    *,
    sp: ArrayLike | None = None,
    auto: ArrayLike | None = None,
    period: float = 1.0,
    criterion: str = "auto",
    confidence: float = 0.9,
    method: str = "search",
    surface: bool = False,
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
        method: ``"search"``, or whose valve and process are returned instead: the paper's
            optimisation from blind starts (``"nlp"``) or from the search's optimum
            (``"nlp-polish"``), or its grid (``"grid"``, steps of 4 % of OP's span). They have no
            intervals; the verdict is the search's.
        surface: whether to map the cost over (S, J), for a picture.

    Returns:
        The result; :meth:`Identification.to_dict` is its JSON form. A window that cannot be judged
        is a result too (``not_assessable`` with reasons), not an error.

    Raises:
        EstimatorError: not a window at all (shapes, types, no finite sample, unknown option), or
            a method of the paper on a window with bad samples or without CasADi.
    """
    begun = time.perf_counter()
    if criterion not in CRITERIA:
        raise EstimatorError(f"criterion is {criterion!r}: choose one of {', '.join(CRITERIA)}")
    if method not in METHODS:
        raise EstimatorError(f"method is {method!r}: choose one of {', '.join(METHODS)}")
    if not 0.5 <= confidence <= 0.999:
        raise EstimatorError(f"confidence is {confidence!r}: give a share from 0.5 to 0.999")
    window = harmonise(op, pv, sp, auto, period)
    reasons = screen(window)
    if reasons:
        result = _not_assessable(window, reasons, criterion, confidence)
    else:
        # the matrices are small: BLAS threads only wait for each other
        with _BLAS.limit(limits=1, user_api="blas"):
            result = _assess(window, criterion, confidence, method, surface)
    return replace(result, seconds=time.perf_counter() - begun)


def warm_up() -> None:
    """Load or compile the kernels, so that the first window does not wait for them."""
    k = np.arange(200.0)
    identify(np.sin(k / 9.0), np.sin(k / 9.0 - 0.3))


def _assess(
    window: Window, criterion: str, confidence: float, method: str, surface: bool
) -> Identification:
    op = op_of(window.u)
    regression = Regression(window.y, window.good)
    healthy = healthy_search(op, regression)
    seeds = one_step_seeds(op, window.y, window.good, _SEEDS)
    seeds = seeds or valve_search(op, regression, healthy, ())[:1]
    if not seeds:
        share = 1.0 - healthy.cost / regression.total
        reason = Reason(
            ReasonCode.TOO_FEW_MOVES,
            f"OP's moves are too few to move a sticky valve twice (healthy fit {share:.3f})",
        )
        return _not_assessable(window, (reason,), criterion, confidence)
    straight = select_orders(window.y, window.good, window.u)[0]
    arx = arx_search(op, window.y, window.good, seeds, straight.bic)
    arx, nearby = _agreed(window, op, regression, arx, healthy, straight)
    without = healthy_bic(op, regression, healthy, straight)
    found, simulated, samples, test = _searched(
        op, regression, healthy, seeds, arx, nearby, criterion, without
    )
    best = found[0]
    stem = (best if simulated > 0.0 else arx.best).stem(op)
    evidence = evidence_of(stem, simulated, test.evidence, samples, best.band)
    if score_of(evidence) > 0.0:
        outside = outside_search(op, regression)
        evidence = replace(
            evidence,
            simulated=min(simulated, against_outside(op, regression, best, outside)),
            whitened=min(test.evidence, test.against(outside, op)),
        )
    score = score_of(evidence)
    fit = Fit(1.0 - best.cost / regression.total, 1.0 - healthy.cost / regression.total)
    verdict, reasons = judge(score, evidence, fit)
    if method != "search":
        estimate = published_estimate(window, op, arx, method)
    elif criterion == "arx":
        estimate = arx_estimate(window, op, arx, confidence)
    else:
        sticky = verdict is Verdict.STICTION
        agree = abs(arx.best.band - best.band) <= _SAME * best.band
        # in a tie the one whose sets of slips are listed without a gap, if both mean one valve
        one_step = test.ahead > TIE or (agree and test.ahead > -TIE)
        if criterion == "auto" and sticky and one_step:
            estimate = arx_estimate(window, op, arx, confidence)
            if not np.isfinite(estimate.simulated).all():
                estimate = simulable(window, regression, estimate, confidence)
        else:
            bic = test.oe * test.count
            estimate = oe_estimate(
                window, op, regression, found, confidence, bic, sticky=sticky or criterion == "oe"
            )
    span = window.op_span
    band, jump = estimate.band.scaled(span), estimate.jump.scaled(span)
    return Identification(
        verdict=verdict,
        reasons=reasons,
        score=score,
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
        model=LoopModel(ValveModel(band.value, jump.value), estimate.model),
        stem=window.op_centre + span * estimate.stem,
        pv_model=window.pv_centre + window.pv_scale * estimate.simulated,
        surface=cost_surface(window, op, regression, estimate.simulating or nearby)
        if surface
        else None,
        runners_up=estimate.runners_up,
        identifiability=identifiability(estimate, span, sticky=verdict is Verdict.STICTION),
        criterion_reason=criterion_reason(
            criterion if method == "search" else method,
            estimate,
            verdict,
            test.ahead,
        ),
    )


def _agreed(
    window: Window,
    op: Op,
    regression: Regression,
    arx: ArxFound,
    healthy: Candidate,
    straight: ArxOrders,
) -> tuple[ArxFound, Candidate]:
    """The one-step criterion's valve under the simulation criterion, and what both agree upon.

    A dead time that is too long for a band that is too narrow is a poor optimum of both. The
    simulation criterion finds the way out of it, and the other one follows.
    """
    nearby = adopted(op, regression, arx.best)
    if nearby.cost > HOPELESS * healthy.cost:
        return arx, nearby
    short = shortened(op, regression, nearby, _FAR_LATER)
    if short.cost < nearby.cost:
        again = arx_search(op, window.y, window.good, (short,), straight.bic)
        if again.bic_per_sample < arx.bic_per_sample:
            arx = again
    return arx, short


def _searched(
    op: Op,
    regression: Regression,
    healthy: Candidate,
    seeds: tuple[Candidate, ...],
    arx: ArxFound,
    nearby: Candidate,
    criterion: str,
    bic: float,
) -> tuple[tuple[Candidate, ...], float, float, OneStepTest]:
    """The simulation criterion's valves, best first; what both tests say of them.

    Where the one-step criterion's valve settles the verdict, a wide search under the other one
    could only make a sticky valve likelier still. It is left out where it could not change the
    estimate either: the one-step criterion is the better one, or its valve (``nearby``, refined for
    simulation) serves the other one even better than itself. The effective samples that the
    simulated test counts come back between both.
    """
    found: tuple[Candidate, ...] = (nearby,)
    simulated, samples = simulated_test(op, regression, found[0], healthy)
    if criterion != "oe" and simulated > _CLEAR:
        test = one_step_test(op, regression, found[0], arx, bic, simulated)
        if test.evidence > 2.0 * _CLEAR:
            if test.ahead > TIE:
                return found, simulated, samples, test
            if test.ahead < -_PLAIN:
                found = shortest(op, regression, restructured(op, regression, found[0]), 1)
                return found, *simulated_test(op, regression, found[0], healthy), test
    searched = valve_search(op, regression, healthy, (*seeds, arx.best))
    found = tuple(sorted((*found, *searched), key=lambda candidate: candidate.cost))
    simulated, samples = simulated_test(op, regression, found[0], healthy)
    if simulated > 0.0:
        found = shortest(op, regression, found)
        simulated, samples = simulated_test(op, regression, found[0], healthy)
    test = one_step_test(op, regression, found[0], arx, bic, simulated)
    return found, simulated, samples, test


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
        evidence=Evidence(0.0, 0.0, 0.0, 0, 0, 0, 0.0),
        samples=window.size,
        period_s=window.period,
        seconds=0.0,
        model=None,
        stem=nothing,
        pv_model=nothing.copy(),
        surface=None,
    )
