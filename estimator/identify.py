"""One window in, one :class:`Identification` out: the order of the steps, and nothing else.

Prepare the rows, weigh the healthy against the sticky valve, judge, estimate, report.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from estimator.arrays import Array
from estimator.averaging import average, block_of, with_every_sample
from estimator.cleaning import (
    Cleaned,
    Held,
    as_recorded,
    clean,
    find_held,
    find_slow_transmitter,
    screen_faults,
)
from estimator.criteria.likelihood import simulate
from estimator.criteria.registry import CRITERIA, Request
from estimator.evidence.effect import effect_of
from estimator.evidence.records import informed_share, step_left_out
from estimator.evidence.sign import gain_sign, soonest_answer
from estimator.evidence.steadiness import steady_evidence
from estimator.evidence.verdict import describe_stem, judge
from estimator.evidence.weighing import Weighing, weigh, with_varying_friction
from estimator.hypotheses.gain import gain_deviations
from estimator.hypotheses.hypothesis import Case
from estimator.outcomes import EstimatorError, Reason, ReasonCode
from estimator.published.as_answer import METHODS, published_estimate
from estimator.report import describe, unassessed
from estimator.result import Evidence, Fit, Identification
from estimator.rows import rows_of
from estimator.settings import SETTINGS, Settings
from estimator.surface import cost_surface
from estimator.window import Window, harmonise, period_of, screen, signals_of

__all__ = ["METHODS", "identify"]


def identify(
    op: ArrayLike,
    pv: ArrayLike,
    *,
    sp: ArrayLike | None = None,
    auto: ArrayLike | None = None,
    period: float | None = None,
    criterion: str = "auto",
    confidence: float = 0.9,
    method: str = "search",
    surface: bool = False,
    settings: Settings = SETTINGS,
) -> Identification:
    """Judge the valve of one loop from one window of OP and PV.

    Args:
        op: controller output, shape ``(n,)``; NaN marks a bad sample.
        pv: process variable, shape ``(n,)``, same scans as ``op``; NaN marks a bad sample.
        sp: set-point, shape ``(n,)``, optional; it helps to tell the sign of the process gain.
        auto: non-zero where the controller is in automatic, shape ``(n,)``, optional.
        period: seconds between samples; without it those of a pandas index of times, or 1 s.
        criterion: ``"auto"`` (simulation with coloured noise), ``"oe"`` (simulation with white
            noise) or ``"arx"`` (one-step-ahead, the paper's (12)).
        confidence: of the intervals, between 0.5 and 0.999.
        method: ``"search"``, or whose valve and process are returned instead: the paper's
            optimisation from blind starts (``"nlp"``) or from the search's optimum
            (``"nlp-polish"``), or its grid (``"grid"``, steps of 4 % of OP's span). They minimise
            one-step-ahead errors and have no intervals; the verdict is the search's.
        surface: whether to map the cost over (S, J), for a picture.
        settings: every chosen number; see `estimator.settings`.

    Returns:
        The result; :meth:`Identification.to_dict` is its JSON form. A window that cannot be judged
        is a result too (``not_assessable`` with reasons), not an error.

    Raises:
        EstimatorError: not a window at all (shapes, types, no finite sample, unknown option,
            indexes that differ, times in uneven steps or that contradict the period), a method of
            the paper asked for under another criterion than its own, or on a window with
            bad samples, or without CasADi.
    """
    begun = time.perf_counter()
    if criterion not in CRITERIA:
        raise EstimatorError(f"criterion is {criterion!r}: choose one of {', '.join(CRITERIA)}")
    if method not in METHODS:
        raise EstimatorError(f"method is {method!r}: choose one of {', '.join(METHODS)}")
    if method != "search" and criterion == "oe":
        raise EstimatorError(
            f"method {method!r} minimises one-step-ahead errors and criterion 'oe' simulation "
            f"errors: use criterion 'arx' or 'auto' with it, or method 'search'"
        )
    if not (isinstance(confidence, (int, float, np.number)) and 0.5 <= confidence <= 0.999):
        raise EstimatorError(f"confidence is {confidence!r}: give a share from 0.5 to 0.999")
    period = period_of(period, op, pv, sp, auto)
    window = harmonise(op, pv, sp, auto, period, settings.screening)
    given, others = signals_of(op, {"pv": pv, "sp": sp, "auto": auto})
    measured, setpoint = others["pv"], others.get("sp")
    # the methods of the paper take every sample, as it is
    held = _find_held(given, measured) if method == "search" else None
    if held is not None:
        result = identify(
            given[held.at],
            measured[held.at],
            sp=held.thin(setpoint),
            auto=held.thin(others.get("auto")),
            period=held.every * window.period,
            criterion=criterion,
            confidence=confidence,
            surface=surface,
            settings=settings,
        )
        return replace(
            result,
            identifiability=(*result.identifiability, held.why),
            stem=held.hold(result.stem, window.size),
            pv_model=held.hold(result.pv_model, window.size),
            seconds=time.perf_counter() - begun,
        )
    informed = informed_share(measured)
    reasons = screen(window, informed, settings.screening)
    cleaned = Cleaned(measured, np.zeros(window.size, dtype=np.bool_), 0, None)
    if not reasons and method == "search":
        cleaned = clean(given, measured, setpoint, settings.screening)
        if cleaned.faults.any() or cleaned.late > 0:
            window = harmonise(op, cleaned.pv, sp, auto, period, settings.screening)
            reasons = screen_faults(window, cleaned.faults, settings.screening)
    if reasons:
        result = unassessed(window, reasons, criterion, confidence)
    else:
        sign = gain_sign(given, cleaned.pv, setpoint, cleaned.controller, settings.modelling)
        left_out = step_left_out(given, measured, informed)
        soonest = soonest_answer(given, cleaned.pv, setpoint, sign, settings.modelling)
        request = Request(criterion, confidence, method, surface, sign, informed, left_out, soonest)
        result = _assess(window, request, settings)
        result = replace(
            result,
            reasons=(*result.reasons, *cleaned.tell()),
            identifiability=(*result.identifiability, *cleaned.tell_late()),
            pv_model=as_recorded(result.pv_model, cleaned.late),
        )
    return replace(result, seconds=time.perf_counter() - begun)


def _find_held(op: Array, pv: Array) -> Held | None:
    """How values stand for several samples; None where each is one of its own."""
    together = find_held(op, pv)
    held = together if together.why else find_slow_transmitter(pv)
    return held if held.why else None


def _assess(whole: Window, request: Request, settings: Settings) -> Identification:
    # the paper's criterion and methods are for every sample
    plain = request.criterion == "arx" or request.method != "search"
    block = 1 if plain else block_of(whole.u, settings.screening)
    window = whole if block == 1 else average(whole, block)
    criterion = CRITERIA[request.criterion]
    modelling = criterion.modelling(settings.modelling)
    # averages of OP and PV over the same samples answer each other at once
    soonest = request.soonest if block == 1 else 0
    rows = rows_of(window, request.sign, modelling, request.informed, soonest)
    case = Case(rows, replace(settings, modelling=modelling))
    weighing = weigh(case)
    # slips that may be anywhere take up noise that a criterion does not allow
    if request.criterion == "auto" and request.method == "search":
        weighing = with_varying_friction(case, weighing)
    if weighing.sticky is None:
        reason = Reason(
            ReasonCode.TOO_FEW_MOVES, "OP's moves are too few to move a sticky valve twice"
        )
        return unassessed(whole, (reason,), request.criterion, request.confidence)
    evidence, fit = _evidence(case, weighing, request)
    judgement = judge(evidence, fit, case.settings)
    if request.method == "search":
        estimate = criterion.estimate(case, window, weighing, request.confidence)
    else:
        estimate = published_estimate(case, window, weighing.sticky, request.method)
    result = describe(
        window,
        estimate,
        judgement,
        evidence,
        fit,
        weighing,
        request.confidence,
        case.max_dead_time,
        cost_surface(case, window, weighing.sticky) if request.surface else None,
    )
    return result if block == 1 else with_every_sample(result, case, whole, weighing, block)


def _evidence(case: Case, weighing: Weighing, request: Request) -> tuple[Evidence, Fit]:
    sticky, healthy = weighing.sticky, weighing.healthy
    assert sticky is not None
    best = weighing.best
    assert best.valve is not None
    # of the laws the one that was weighed
    seen = sticky if weighing.varying is None else best
    moves, reversals, strokes = describe_stem(seen.stem)
    evidence = Evidence(
        log_bayes_factor=weighing.evidence,
        steady=steady_evidence(case, healthy, seen),
        effect=effect_of(case, best),
        process=max(case.evidence_of_process(one) for one in (healthy, sticky)),
        gain_deviations=gain_deviations(case, healthy),
        disturbances=healthy.disturbances,
        moves=moves,
        reversals=reversals,
        strokes=strokes,
        band_over_span=best.valve.band,
        informed=request.informed,
        gain_sign=int(case.rows.sign),
        law=best.valve.law,
        left_out=request.left_out,
        over_waves=weighing.over_waves,
    )
    return evidence, Fit(simulate(case, best)[1], simulate(case, healthy)[1])
