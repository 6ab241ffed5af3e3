"""The search for the valve under the one-step-ahead criterion, with its orders."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from estimator._kernels import Array, Mask
from estimator._listing import slip_patterns
from estimator._one_step import one_step_costs, refine_one_step
from estimator._slips import FirstSlips, Op, first_slips
from estimator.arx import ArxOrders, ArxRegression, select_orders
from estimator.candidate import Candidate, first_apart
from estimator.listed import judged_again, listed_posterior
from estimator.one_step_likelihood import OneStepLikelihood
from estimator.posterior import Posterior

__all__ = ["VALVE_PARAMETERS", "ArxFound", "arx_search"]

VALVE_PARAMETERS = 3
_SEED_ORDERS = 3, 2
_HOPELESS = 1.25
"""Seeds whose cost in the listing is above the best one's by this factor are not looked at."""
_FINALISTS = 2
_APART = 0.1
"""Share by which their stick bands differ: what is nearer, the listing around one sees."""
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
        return self.regression.count * self.bic_per_sample

    @property
    def bic_per_sample(self) -> float:
        """The same per sample, for comparing: orders differ in how many samples they predict."""
        return _bic_per_sample(self.regression, self.best.cost)


def _bic_per_sample(regression: ArxRegression, cost: float) -> float:
    count, orders = regression.count, regression.orders
    free = orders.na + orders.nb + 2 + VALVE_PARAMETERS
    return math.log(cost / count) + free * math.log(count) / count


class _Course:
    """A window's OP, its median step per sample and its first slips by direction; regressions."""

    def __init__(self, op: Op, y: Array, good: Mask) -> None:
        self.op, self.y, self.good = op, y, good
        self.step = float(np.median(np.abs(np.diff(op.u))))
        self.starts: dict[float, FirstSlips] = {
            first: first_slips(op.u, first) for first in (1.0, -1.0)
        }
        self._regressions: dict[tuple[int, int, int], ArxRegression] = {}

    def regression(self, orders: ArxOrders) -> ArxRegression:
        """That of these orders, made once."""
        key = orders.na, orders.nb, orders.dead_time
        if key not in self._regressions:
            self._regressions[key] = ArxRegression(self.y, self.good, orders)
        return self._regressions[key]

    def ranked(self, candidate: Candidate) -> list[ArxOrders]:
        """Orders for a valve, best first."""
        return select_orders(self.y, self.good, candidate.stem(self.op))

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

    The seeds are refined with orders fixed; each chooses its own orders, those of the lowest BIC
    among which no two are alike are refined again, and the lowest BIC wins.
    """
    course = _Course(op, y, good)
    judged: list[_Judged] = []
    limit = _HOPELESS * min(seed.cost for seed in seeds)
    for seed in seeds:
        if seed.cost > limit and seed is not seeds[0]:
            continue
        regression = course.regression(ArxOrders(*_SEED_ORDERS, max(1, seed.dead_time)))
        looked = _looked(course, regression, seed, _LOOKS[0])
        judged.append(_judged(course, _restarted(course, regression, looked)))
    judged.sort(key=lambda one: one.bic)
    least = judged[0].bic + _BEHIND / op.u.size
    others = [one.best.anchored(op) for one in judged]
    found = [
        _settled(course, one, others, healthy)
        for one in first_apart(judged, _FINALISTS, _Judged.apart)
        if one.bic <= least
    ]
    return min(found, key=lambda one: one.bic_per_sample)


class _Judged(NamedTuple):
    """A valve with the orders that suit it, and its BIC per sample."""

    bic: float
    best: Candidate
    ranked: list[ArxOrders]

    def apart(self, other: _Judged) -> bool:
        """Whether a listing around one valve would hardly see the other."""
        here, there = self.best, other.best
        return here.dead_time != there.dead_time or abs(here.band - there.band) > _APART * here.band


def _judged(course: _Course, candidate: Candidate) -> _Judged:
    ranked = course.ranked(candidate)
    regression = course.regression(ranked[0])
    best = _costed(course.op, regression, replace(candidate, dead_time=ranked[0].dead_time))
    return _Judged(_bic_per_sample(regression, best.cost), best, ranked)


def _settled(course: _Course, start: _Judged, others: list[Candidate], healthy: float) -> ArxFound:
    """Orders for the valve, and the valve for these orders, until both agree.

    The first slips of all ``others``, anchored, are tried with it.
    """
    op, best, ranked = course.op, start.best, start.ranked
    posterior, middle = None, 0.0
    worth = ranked[0].bic < healthy - _WORTH
    for _ in range(_ROUNDS):
        orders = ranked[0]
        regression = course.regression(orders)
        best = _costed(op, regression, replace(best, dead_time=orders.dead_time))
        if worth:
            variance = best.cost / regression.count
            likelihood = OneStepLikelihood(course.y, course.good, orders, variance)
            if posterior is None:
                best = _restarted(course, regression, best).anchored(op)
                leads = [one.lead for one in others if one.first == best.first]
                posterior, middle = listed_posterior(op, likelihood, best, leads), best.band
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
        ranked = course.ranked(best)
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
    _, nodes, _, costs = slip_patterns(
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
