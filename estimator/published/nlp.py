"""The paper's one-stage optimisation with CasADi and IPOPT: blind, as published, and as a polish.

`nlp_paper` is the method of section 3: theta from (9)-(10), M starts, the smoothed valve, bounds
and constraints (11), the best end point kept. It works on the window as it is, in its own units;
where it stops in a poor local minimum, the result says so and shows every start.

`nlp_polish` starts from the optimum of another method. It scales OP and PV, lets the stem
before the first sample be an unknown, and raises the sharpness in stages. Every stage's end is
judged with He's own valve and least squares, at the best of the valves that make the same moves
(`moves`); the best is returned, the start included, so it is never worse than what it was given.

Source: Bacci di Capaci, Vaccari, Pannocchia and Scali (2018).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from estimator.monitoring.indices import apparent_stiction
from estimator.outcomes import EstimatorError
from estimator.published.nlp_problem import Programme, Solution, SolverOutcome, require_casadi
from estimator.published.nlp_starts import starting_frictions
from estimator.published.paper_fit import ArxStructure, ArxWindow, InitialStem, PaperFit
from estimator.published.same_moves import best_with_same_moves
from estimator.valves import HeValve, SmoothedValve

__all__ = ["NlpAttempt", "NlpFit", "SolverOutcome", "nlp_paper", "nlp_polish"]


# A polish starts so soft (tau per standard deviation of OP), and stays so near (share of the span).
_SOFTEST = 30.0
_REACH = 0.1


@dataclass(frozen=True, slots=True)
class NlpAttempt:
    """One run of IPOPT.

    Attributes:
        start: ``(fS, fD)`` that it began with.
        stem0: stem before the first sample that it began with.
        tau: sharpness, per unit of OP.
        end: ``(fS, fD)`` that it ended with.
        cost: equation (12) at its end; for a polish, of He's own valve with least-squares theta.
        variance_ratio: variance of the stem over that of OP at its end, to compare with alpha.
        outcome, iterations: of IPOPT.
    """

    start: tuple[float, float]
    stem0: float
    tau: float
    end: tuple[float, float]
    cost: float
    variance_ratio: float
    outcome: SolverOutcome
    iterations: int


@dataclass(frozen=True, slots=True)
class NlpFit:
    """The best fit, whose ``evaluations`` are IPOPT's iterations, and all that was tried for it."""

    best: PaperFit
    attempts: tuple[NlpAttempt, ...]

    @property
    def solved(self) -> int:
        """Attempts in which IPOPT reported success."""
        return sum(attempt.outcome is SolverOutcome.SOLVED for attempt in self.attempts)


def nlp_paper(
    op: ArrayLike,
    pv: ArrayLike,
    *,
    na: int,
    nb: int,
    dead_time: int = 1,
    tau: float = 250.0,
    starts: int = 7,
    step: float = 0.5,
    initial: Iterable[str | InitialStem] = (InitialStem.FIRST, InitialStem.MEAN),
    alpha: float = 0.1,
    intercept: bool = True,
    max_iterations: int = 200,
    period: float = 1.0,
) -> NlpFit:
    """Solve (11) from ``starts`` blind starts for each initial position, as the paper does.

    Args:
        op, pv: samples, shape ``(n,)``, finite, used as they are.
        na, nb, dead_time, intercept: see `ArxStructure`.
        tau: sharpness per unit of OP (the paper: 250 on industrial data, 1e4 once).
        starts: M, for each initial position.
        step: distance of the starts on the triangle's boundary, in units of OP.
        initial: which of the paper's two positions of the stem before the first sample.
        alpha: least variance of the stem over OP's, (11b).
        max_iterations: bound of IPOPT for each start.
        period: seconds between samples, passed on to the process.

    Returns:
        The end with the lowest cost (12) among those that keep (11b), with the smoothed valve and
        IPOPT's theta. Where no end keeps it, the end that comes nearest.

    Raises:
        EstimatorError: unusable window or options, or CasADi is not installed.
    """
    require_casadi()
    choices = [InitialStem(choice) for choice in initial]
    if not choices:
        raise EstimatorError("initial is empty: give 'first', 'mean' or both")
    structure = ArxStructure(na, nb, dead_time, intercept=intercept)
    window = ArxWindow.of(op, pv, structure, period=period)
    programme = Programme(window.op, window.pv, structure, alpha, max_iterations)
    theta0 = window.solve(window.op)[0]
    width = apparent_stiction(window.op, window.pv).apparent_stiction
    pairs = starting_frictions(window.span, width, count=starts, step=step)
    attempts: list[NlpAttempt] = []
    fits: list[PaperFit] = []
    for choice in choices:
        stem0 = choice.position(window.op)
        for pair in pairs:
            end = programme.solve(*pair, stem0, theta0, tau=tau, free_stem0=False)
            if not end.is_finite:
                end = Solution(*pair, stem0, theta0, SolverOutcome.FAILED, end.iterations)
            fit = window.fit(_smoothed(end, tau), stem0, theta=end.theta)
            fits.append(fit)
            attempts.append(_attempt(window, pair, stem0, tau, end, fit))
    shortfall = [max(0.0, alpha * (1 - 1e-6) - a.variance_ratio) for a in attempts]
    best = min(range(len(fits)), key=lambda i: (shortfall[i], attempts[i].cost))
    iterations = sum(attempt.iterations for attempt in attempts)
    return NlpFit(replace(fits[best], evaluations=iterations), tuple(attempts))


def nlp_polish(
    op: ArrayLike,
    pv: ArrayLike,
    stick_band: float,
    slip_jump: float,
    *,
    na: int,
    nb: int,
    dead_time: int = 1,
    stem0: float | None = None,
    tau: float = 1e4,
    stages: int = 4,
    alpha: float = 0.1,
    intercept: bool = True,
    max_iterations: int = 50,
    period: float = 1.0,
) -> NlpFit:
    """Improve a valve by the scaled programme; never worse than the start.

    Args:
        op, pv: the window, shape ``(n,)`` each.
        na, nb, dead_time, intercept, alpha, period: as in `nlp_paper`.
        stick_band, slip_jump: the optimum to start from, in units of OP.
        stem0: its stem before the first sample (default: the first OP).
        tau: sharpness of the last stage, per standard deviation of OP.
        stages: sharpness rises geometrically from 30 to ``tau`` in this many steps.
        max_iterations: bound of IPOPT for each stage.

    Returns:
        The best of the start and every stage's end, judged by equation (12) with He's valve and
        theta by least squares.

    Raises:
        EstimatorError: unusable window or options, or CasADi is not installed.
        ValueError: the start is not a valve.
    """
    require_casadi()
    structure = ArxStructure(na, nb, dead_time, intercept=intercept)
    window = ArxWindow.of(op, pv, structure, period=period)
    # A shift of OP and PV is free only when the model has an intercept to take it up.
    op_zero = float(window.op.mean()) if intercept else 0.0
    pv_zero = float(window.pv.mean()) if intercept else 0.0
    op_unit = float(window.op.std())
    position = float(window.op[0]) if stem0 is None else float(stem0)
    given = window.fit(HeValve(stick_band, slip_jump), position)
    best = here = best_with_same_moves(window, given)
    # In units of the start's own error the cost is about half the number of samples.
    floor = 1e-6 * float(window.pv.std()) or 1.0
    pv_unit = max(floor, math.sqrt(2.0 * best.cost / window.target.size))
    scaled = ArxWindow.of(
        (window.op - op_zero) / op_unit, (window.pv - pv_zero) / pv_unit, structure
    )
    programme = Programme(scaled.op, scaled.pv, structure, alpha, max_iterations, warm=True)
    reach = _REACH * window.span / op_unit
    attempts: list[NlpAttempt] = []
    # Each stage goes on from the end of the one before it, even where that is worse for the sharp
    # valve: its own minimum is what leads to the next one's.
    for sharpness in np.geomspace(min(_SOFTEST, tau), tau, stages).tolist():
        begun = here
        pair = (begun.static_friction, begun.dynamic_friction)
        end = programme.solve(
            pair[0] / op_unit,
            pair[1] / op_unit,
            (begun.stem0 - op_zero) / op_unit,
            scaled.solve((begun.stem - op_zero) / op_unit)[0],
            tau=sharpness,
            free_stem0=True,
            reach=reach,
        )
        if end.is_finite:
            end = Solution(
                end.static_friction * op_unit,
                end.dynamic_friction * op_unit,
                end.stem0 * op_unit + op_zero,
                end.theta,
                end.outcome,
                end.iterations,
            )
            here = best_with_same_moves(window, window.fit(_exact(end), end.stem0))
        attempts.append(_attempt(window, pair, begun.stem0, sharpness / op_unit, end, here))
        if here.cost < best.cost and attempts[-1].variance_ratio >= alpha:
            best = here
    iterations = sum(attempt.iterations for attempt in attempts)
    return NlpFit(replace(best, evaluations=iterations), tuple(attempts))


def _triangle(solution: Solution) -> tuple[float, float]:
    """IPOPT's frictions, put back onto the triangle that it may leave by its tolerance."""
    dynamic = max(0.0, solution.dynamic_friction)
    return max(dynamic, solution.static_friction), dynamic


def _exact(solution: Solution) -> HeValve:
    return HeValve.from_friction(*_triangle(solution))


def _smoothed(solution: Solution, tau: float) -> SmoothedValve:
    static, dynamic = _triangle(solution)
    return SmoothedValve(static + dynamic, static - dynamic, tau=tau)


def _attempt(
    window: ArxWindow,
    start: tuple[float, float],
    stem0: float,
    tau: float,
    end: Solution,
    fit: PaperFit,
) -> NlpAttempt:
    return NlpAttempt(
        start=start,
        stem0=stem0,
        tau=tau,
        end=(end.static_friction, end.dynamic_friction),
        cost=fit.cost if math.isfinite(fit.cost) else math.inf,
        variance_ratio=float(fit.stem.var()) / float(window.op.var()),
        outcome=end.outcome,
        iterations=end.iterations,
    )
