"""One window in, one :class:`Identification` out: the order of the steps, and nothing else."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from itertools import product
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import ThreadpoolController

from estimator._simulated import simulated_costs
from estimator._slips import Op, op_of
from estimator.arx import select_orders
from estimator.arx_estimate import arx_estimate
from estimator.arx_search import ArxFound, arx_search
from estimator.candidate import Candidate
from estimator.estimate import Estimate
from estimator.exhaustive import one_step_seeds
from estimator.noise import effective_samples
from estimator.oe_estimate import oe_estimate
from estimator.outcomes import EstimatorError, Reason, ReasonCode, Verdict
from estimator.outside import Outside, outside_search
from estimator.published import METHODS, published_estimate
from estimator.regression import Regression
from estimator.result import CostSurface, Evidence, Fit, Identification, Interval, Process
from estimator.search import adopted, healthy_search, valve_search
from estimator.verdict import evidence_of, judge, score_of, simulated_evidence
from estimator.whitened import whitened_bic
from estimator.window import Window, harmonise, screen
from estimator.words import criterion_reason, identifiability
from loop_model import LoopModel, ValveModel

__all__ = ["CRITERIA", "METHODS", "identify", "warm_up"]

CRITERIA = ("auto", "oe", "arx")
"""Criteria that :func:`identify` knows."""

_SURFACE_NODES = 25
_SEEDS = 5
_MARGIN, _SETTLED = 0.15, 0.25
"""BIC per sample by which one-step errors must be better than whitened simulation errors: for the
one-step criterion to be the estimate's, and for the search under the other one to be left out."""
_CLEAR = 12.0
"""Log Bayes factor of a sticky valve from which that search is left out."""
_WORSE = 1.5
_SLACK = 0.08
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
    arx = arx_search(op, window.y, window.good, seeds)
    healthy_bic = _healthy_bic(window, op, regression, healthy)
    # the other criterion's valve may be a good one for this criterion as well
    found: tuple[Candidate, ...] = (adopted(op, regression, arx.best),)
    simulated, samples = _simulated(op, regression, found[0], healthy)
    settled = criterion != "oe" and not surface and simulated > _CLEAR
    if settled:
        test = _one_step_test(op, regression, found[0], arx, healthy_bic, simulated)
        settled = test.settles(arx)
    if not settled:
        searched = valve_search(op, regression, healthy, (*seeds, arx.best))
        found = tuple(sorted((*found, *searched), key=lambda candidate: candidate.cost))
        simulated, samples = _simulated(op, regression, found[0], healthy)
        test = _one_step_test(op, regression, found[0], arx, healthy_bic, simulated)
    best = found[0]
    stem = (best if simulated > 0.0 else arx.best).stem(op)
    evidence = evidence_of(stem, simulated, test.evidence, samples, best.band)
    if score_of(evidence) > 0.0:
        outside = outside_search(op, regression)
        evidence = replace(
            evidence,
            simulated=min(simulated, _against_outside(op, regression, best, outside)),
            whitened=min(test.evidence, test.against(outside, op)),
        )
    score = score_of(evidence)
    fit = Fit(1.0 - best.cost / regression.total, 1.0 - healthy.cost / regression.total)
    verdict, reasons = judge(score, evidence, fit)
    estimate: Estimate | None = None
    if method != "search":
        estimate = published_estimate(window, op, arx, method)
    elif criterion == "arx" or (
        criterion == "auto"
        and verdict is Verdict.STICTION
        and arx.bic < test.oe_bic - _MARGIN * window.size
    ):
        rival = arx_estimate(window, op, arx, confidence)
        if criterion == "arx" or simulated <= 0.0 or _simulates(window, rival, best):
            estimate = rival
    if estimate is None:
        sticky = verdict is Verdict.STICTION or criterion == "oe"
        estimate = oe_estimate(
            window, op, regression, found, confidence, test.oe_bic, sticky=sticky
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
        surface=_surface(window, op, regression, best) if surface else None,
        runners_up=estimate.runners_up,
        identifiability=identifiability(estimate, span, sticky=verdict is Verdict.STICTION),
        criterion_reason=criterion_reason(
            criterion if method == "search" else method,
            estimate,
            verdict,
            (test.oe_bic - arx.bic) / window.size,
        ),
    )


def _simulated(
    op: Op, regression: Regression, best: Candidate, healthy: Candidate
) -> tuple[float, float]:
    """Log Bayes factor from simulation errors, and the effective samples it counts."""
    samples = min(
        effective_samples(
            regression.solve(stem, c.structure, c.dead_time).residual, regression.weight
        )
        for stem, c in ((best.stem(op), best), (op.u, healthy))
    )
    return simulated_evidence(healthy.cost, best.cost, samples), samples


def _against_outside(op: Op, regression: Regression, best: Candidate, outside: Outside) -> float:
    """Log Bayes factor of a sticky valve over a sinusoid, from simulation errors.

    Both have three parameters more than a healthy valve alone.
    """
    rival = outside.process
    samples = min(
        effective_samples(r.solve(stem, c.structure, c.dead_time).residual, r.weight)
        for r, stem, c in (
            (regression, best.stem(op), best),
            (outside.regression, op.u, rival),
        )
    )
    return 0.5 * samples * math.log(rival.cost / best.cost)


@dataclass(frozen=True, slots=True)
class _OneStepTest:
    """Sticky against healthy valve by one-step errors: the best noise model of each.

    ``sticky`` and ``healthy`` are BIC per sample, because criteria lose a few samples each at the
    start of the window.
    """

    sticky: float
    healthy: float
    count: float
    oe_bic: float

    @property
    def evidence(self) -> float:
        """Log Bayes factor of a sticky over a healthy valve."""
        return 0.5 * self.count * (self.healthy - self.sticky)

    def settles(self, arx: ArxFound) -> bool:
        """Whether the one-step criterion's valve settles verdict and criterion by itself.

        Whatever a search under the simulation criterion would find besides makes a sticky valve
        more likely still, and would have to be far better to be the estimate.
        """
        sure = self.evidence > 2.0 * _CLEAR
        return sure and arx.bic < self.oe_bic - _SETTLED * arx.regression.count

    def against(self, outside: Outside, op: Op) -> float:
        """Log Bayes factor of a sticky valve over a healthy one and a sinusoid."""
        bic = whitened_bic(op, outside.regression, outside.process, healthy=True)
        return 0.5 * (bic - self.count * self.sticky)


def _one_step_test(
    op: Op,
    regression: Regression,
    best: Candidate,
    arx: ArxFound,
    healthy_bic: float,
    simulated: float,
) -> _OneStepTest:
    sticky_bic, oe_bic = arx.bic / arx.regression.count, math.inf
    if simulated > 0.0:
        oe_bic = whitened_bic(op, regression, best, healthy=False)
        sticky_bic = min(sticky_bic, oe_bic / regression.count)
    return _OneStepTest(sticky_bic, healthy_bic, regression.count, oe_bic)


def _healthy_bic(window: Window, op: Op, regression: Regression, healthy: Candidate) -> float:
    """BIC per sample of the one-step errors with a healthy valve: the better noise model's."""
    orders = select_orders(window.y, window.good, window.u)[0]
    whitened = whitened_bic(op, regression, healthy, healthy=True)
    return min(orders.bic / orders.rows, whitened / regression.count)


def _simulates(window: Window, arx: Estimate, simulated: Candidate) -> bool:
    """Whether the process of the one-step-ahead criterion still simulates PV.

    The criterion is the efficient one where its noise model is right: its innovations are more
    likely than the whitened simulation errors then, and this must hold as well.
    """
    if not np.isfinite(arx.simulated).all():
        return False
    left = float(np.square(window.y - arx.simulated)[window.good].mean())
    return left < _WORSE * simulated.cost / float(window.good.sum()) + _SLACK


def _surface(window: Window, op: Op, regression: Regression, best: Candidate) -> CostSurface:
    nodes = np.linspace(0.0, 1.1, _SURFACE_NODES)[1:]
    jumps = np.linspace(0.0, 1.1, _SURFACE_NODES)
    band, jump = (g.ravel() for g in np.meshgrid(nodes, jumps, indexing="ij"))
    inside = jump <= band + 1e-12
    band, jump = band[inside], np.minimum(jump, band)[inside]
    tables = regression.tables(best.structure)
    least = np.full(band.size, np.inf)
    shares = (0.3, 0.8)
    for first, lead in (*product((-1.0, 1.0), shares), (best.first, best.lead / best.band)):
        valves = np.ascontiguousarray(np.stack([band, jump, lead * band], axis=1))
        found = simulated_costs(op, tables, valves, first, best.dead_time, 1)[0][0]
        least = np.minimum(least, found)
    cost = np.full(inside.size, np.nan)
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
        evidence=Evidence(0.0, 0.0, 0.0, 0, 0, 0, 0.0),
        samples=window.size,
        period_s=window.period,
        seconds=0.0,
        model=None,
        stem=nothing,
        pv_model=nothing.copy(),
        surface=None,
    )
