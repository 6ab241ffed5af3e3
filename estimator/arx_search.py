"""The search for the valve under the one-step-ahead criterion, with its orders."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from estimator._kernels import Array, Mask
from estimator._listing import slip_patterns
from estimator._one_step import one_step_costs, refine_one_step
from estimator._slips import FirstSlips, Op, first_slips
from estimator.arx import ArxOrders, ArxRegression, select_orders
from estimator.candidate import Candidate
from estimator.listed import NARROW, judged_again, listed_posterior
from estimator.one_step_likelihood import OneStepLikelihood
from estimator.posterior import Posterior

__all__ = ["VALVE_PARAMETERS", "ArxFound", "arx_search"]

VALVE_PARAMETERS = 3
_SEED_ORDERS = 3, 2
_HOPELESS = 1.25
"""Seeds whose cost in the listing is above the best one's by this factor are not looked at."""
_FINALISTS = 2
_BEHIND = 25.0
"""BIC by which a finalist may be worse before it is refined."""
_ROUNDS = 3
_NEAR = 1
"""First slips tried around the seed's, each way."""
_MOST = 4000
_LINE = 50


@dataclass(frozen=True, slots=True)
class _Look:
    """How to list sets of slips around a valve.

    ``around``: how far in S, as a share of it; ``factors`` and ``jumps``: how far in J, as
    multiples of it and in steps of OP per sample; ``least``: what is told apart in S and J, in
    steps of OP per sample.
    """

    around: float
    factors: tuple[float, float]
    jumps: float
    least: tuple[float, float]


_LOOKS = (
    _Look(0.015, (0.4, 2.5), np.inf, (0.1, 1.0)),
    _Look(0.004, (0.0, np.inf), 1.5, (0.01, 0.1)),
)
_WIDEST = 0.3
"""How wide in J a listed set may be, as a share of S."""
_PASSES = 5
_BOXES, _SHRINK = np.array([[3, 5, 1], [1, 1, 3]]), np.array([0.5, 0.45, 0.5])
"""S and J are narrowed together; the lead hardly depends on them."""
_WORTH = 20.0
"""BIC by which a valve must be better than a healthy one for all around it to be listed."""
_LISTED = 20
_FINE = 0.02, 0.02, 0.3
"""How far a listed valve is refined in S, J and lead: shares of OP's step, of S, of the step."""


@dataclass(frozen=True, slots=True)
class ArxFound:
    """What the search found: the valve, the regression of its orders, all orders, best first.

    ``posterior`` holds the valves that were listed around it, all with a first slip in its
    direction and stick bands around ``middle``; None where none were.
    """

    best: Candidate
    regression: ArxRegression
    ranked: tuple[ArxOrders, ...]
    posterior: Posterior | None
    middle: float

    @property
    def bic(self) -> float:
        """BIC of its one-step errors, the valve's three parameters counted."""
        count = self.regression.count
        free = self.regression.orders.na + self.regression.orders.nb + 2 + VALVE_PARAMETERS
        return count * math.log(self.best.cost / count) + free * math.log(count)


@dataclass(frozen=True, slots=True)
class _Course:
    """OP, its median step per sample and the first slips by their direction."""

    op: Op
    step: float
    starts: dict[float, FirstSlips]

    @classmethod
    def of(cls, op: Op) -> _Course:
        step = float(np.median(np.abs(np.diff(op.u))))
        return cls(op, step, {first: first_slips(op.u, first) for first in (1.0, -1.0)})

    def leads_near(self, seed: Candidate) -> Array:
        """The seed's lead, and those that move the first slip by some samples."""
        every = self.starts[seed.first]
        at = every.of(seed.lead)
        before, after = every.leads[max(0, at - _NEAR) : at], every.leads[at + 1 : at + 1 + _NEAR]
        return np.concatenate([before, [seed.lead], after])


def arx_search(
    op: Op, y: Array, good: Mask, seeds: tuple[Candidate, ...], healthy: float
) -> ArxFound:
    """Valve and orders that predict PV best; ``healthy`` is the BIC that a healthy valve reaches.

    The seeds are refined with orders fixed; each chooses its own orders, those of the lowest
    BIC are refined again, and the lowest BIC wins.
    """
    course = _Course.of(op)
    regressions: dict[int, ArxRegression] = {}
    judged: list[tuple[list[ArxOrders], Candidate]] = []
    limit = _HOPELESS * min(seed.cost for seed in seeds)
    for seed in seeds:
        if seed.cost > limit and seed is not seeds[0]:
            continue
        delay = max(1, seed.dead_time)
        if delay not in regressions:
            regressions[delay] = ArxRegression(y, good, ArxOrders(*_SEED_ORDERS, delay))
        candidate = _looked(course, regressions[delay], seed, _LOOKS[0])
        judged.append((select_orders(y, good, candidate.stem(op)), candidate))
    judged.sort(key=lambda pair: pair[0][0].bic)
    least = judged[0][0][0].bic + _BEHIND
    found = [
        _settled(course, y, good, candidate, ranked, healthy)
        for ranked, candidate in judged[:_FINALISTS]
        if ranked[0].bic <= least
    ]
    return min(found, key=lambda one: one.bic / one.regression.count)


def _settled(
    course: _Course, y: Array, good: Mask, best: Candidate, ranked: list[ArxOrders], healthy: float
) -> ArxFound:
    """Orders (``ranked``) for the valve, and the valve for these orders, until both agree."""
    op = course.op
    posterior, middle = None, 0.0
    worth = ranked[0].bic < healthy - _WORTH
    for _ in range(_ROUNDS):
        orders = ranked[0]
        regression = ArxRegression(y, good, orders)
        best = _costed(op, regression, replace(best, dead_time=orders.dead_time))
        if worth:
            likelihood = OneStepLikelihood(y, good, orders, best.cost / regression.count)
            if posterior is None:
                best = _restarted(course, regression, best).anchored(op)
                posterior, middle = listed_posterior(op, likelihood, best, NARROW), best.band
            else:
                posterior = judged_again(op, likelihood, best.first, posterior)
        if posterior is not None:
            best = _listed(course, regression, best, posterior)
        listed = best.first
        # a listing has seen what the wider look would
        for look in _LOOKS if posterior is None else _LOOKS[1:]:
            best = _restarted(course, regression, _looked(course, regression, best, look))
            best = _jumped(op, regression, best)
        best = best.anchored(op)
        if best.first != listed:
            posterior = None
        ranked = select_orders(y, good, best.stem(op))
        chosen = ranked[0]
        if (chosen.na, chosen.nb, chosen.dead_time) == (orders.na, orders.nb, orders.dead_time):
            break
    return ArxFound(best, regression, tuple(ranked), posterior, middle)


def _listed(
    course: _Course, regression: ArxRegression, best: Candidate, posterior: Posterior
) -> Candidate:
    """The best listed valve for these orders, refined."""
    likely = np.argsort(-posterior.log_likelihood, kind="stable")[:_LISTED]
    nodes = np.ascontiguousarray(posterior.nodes[likely])
    cost, _ = one_step_costs(course.op, regression.tables, nodes, best.first)
    j = int(cost.argmin())
    state = best.state(cost[j])
    state[1:4] = nodes[j]
    half = np.array([course.step, best.band, course.step]) * _FINE
    refine_one_step(course.op, regression.tables, state, half, _BOXES, _PASSES, _SHRINK)
    return Candidate.of_state(state)


def _costed(op: Op, regression: ArxRegression, candidate: Candidate) -> Candidate:
    """The candidate with its cost for these orders."""
    cost, _ = one_step_costs(op, regression.tables, candidate.valve[None, :3], candidate.first)
    return replace(candidate, cost=float(cost[0]))


def _restarted(course: _Course, regression: ArxRegression, best: Candidate) -> Candidate:
    """The best first slip for the valve; those that follow hardly depend on it."""
    for first in (1.0, -1.0):
        leads = course.starts[first].leads
        if leads.size == 0:
            continue
        nodes = np.column_stack([*np.full((2, leads.size), ((best.band,), (best.jump,))), leads])
        cost, _ = one_step_costs(course.op, regression.tables, np.ascontiguousarray(nodes), first)
        j = int(cost.argmin())
        if cost[j] < best.cost:
            best = replace(best, cost=float(cost[j]), lead=float(leads[j]), first=first)
    return best


def _jumped(op: Op, regression: ArxRegression, best: Candidate) -> Candidate:
    """The best slip jump of all; a valve that makes one move a stroke slips alike with most."""
    jumps = best.band * np.linspace(0.02, 1.0, _LINE)
    nodes = np.column_stack([np.full(_LINE, best.band), jumps, np.full(_LINE, best.lead)])
    cost, _ = one_step_costs(op, regression.tables, nodes, best.first)
    j = int(cost.argmin())
    return replace(best, cost=float(cost[j]), jump=float(jumps[j])) if cost[j] < best.cost else best


def _looked(course: _Course, regression: ArxRegression, seed: Candidate, look: _Look) -> Candidate:
    op, step, leads = course.op, course.step, course.leads_near(seed)
    starts = np.column_stack([leads, np.full(leads.size, seed.first)])
    s0, s1 = seed.band * (1.0 - look.around), seed.band * (1.0 + look.around)
    less, more = look.factors
    j0 = max(0.03 * seed.band, less * seed.jump, seed.jump - look.jumps * step)
    j1 = min(1.1, more * seed.jump, seed.jump + look.jumps * step)
    regions = np.tile(np.array([s0, s1, j0, j1]), (leads.size, 1))
    least = step * np.array(look.least)
    widest = _WIDEST * seed.band
    # regions are told apart within limits, so that their valves need not slip quite like them
    _, nodes, _, costs, _ = slip_patterns(
        op, regression.tables, regions, starts, least, widest, _MOST, exact=True
    )
    own = _costed(op, regression, seed).cost
    state = seed.state(own)
    if costs.size and costs.min() < own:
        best = int(costs.argmin())
        state[0], state[1:4] = costs[best], nodes[best]
    half = np.array([least[0], 0.5 * widest, 0.5 * step])
    refine_one_step(op, regression.tables, state, half, _BOXES, _PASSES, _SHRINK)
    return Candidate.of_state(state)
