"""All valves that explain a window about as well as the best one: sets of slips, listed.

Valves that slip at the same samples fill a box in stick band and slip jump (`estimator._slips`).
The boxes of a wide surrounding are listed for the first slips of the window, those far less likely
than the best are dropped, and the others are listed further as the window grows: so distant peaks
of the likelihood are found that no climb from the best valve would see, for the price of some
thousand evaluations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from estimator._kernels import Array, Index
from estimator._listing import slip_patterns
from estimator._one_step import OneStep, one_step_costs
from estimator._slips import Op, first_slips, op_of, slips, step_of
from estimator.candidate import Candidate
from estimator.posterior import Posterior

__all__ = ["Likelihood", "cut_short", "judged_again", "listed_posterior", "reaching"]

_AROUND = 0.2
"""How far in S is listed, as a share of it; J from nothing to all."""
_KEPT, _LEFT = 400, 1200
"""Boxes that stay of a part of the window, times how much shorter it is than the whole (the first
slips tell little, and to look at them costs little), and those that are left of the whole."""
_LEAST_JUMP = 0.02
_NEAR = 3
"""First slips tried around that of the best valve, each way."""
_FIRST, _GROWTH, _LAST = 5, 1.6, 0.6
"""Slips in the first part, how many times as long the next is, and the share before the whole."""
_STEPS = (0.12, 0.05, 0.02, 0.01)
"""Sets of slips are told apart down to these shares of OP's step per sample, stage by stage."""
_STEP_OF_JUMP = 0.3
_WIDEST = (0.15, 0.1, 0.07, 0.05)
"""The widest box in J, as a share of S."""
_DROP, _LOST = 12.0, 3.0
"""How much less likely than the best a box may be (logarithm; of a part times the root of the same
factor), and than the valve of the search the best of all boxes."""
_MOST = 30_000
_INSIDE, _EDGE = 0.98, 0.02
"""Share of the probability that must be inside of what is listed, and how far, as a share of S."""
_LEADS, _JUMPS = 2, 3
"""Valves tried in each box that is left."""


class Likelihood(Protocol):
    """What one-step costs of the first samples of a window mean."""

    def tables(self, samples: int) -> OneStep:
        """What the compiled sums need."""
        ...

    def log(self, samples: int, cost: Array) -> Array:
        """Log-likelihoods of costs, ``(m,)``."""
        ...


def listed_posterior(
    op: Op, likelihood: Likelihood, best: Candidate, leads: Sequence[float] = ()
) -> Posterior | None:
    """The likelihood around a valve of the search, anchored (`Candidate.anchored`).

    First slips are tried near its own, and those of other valves' ``leads`` in its direction. None
    where the sets of slips are too many to be listed finely: none comes near to the valve.
    """
    starts, feet, gaps = _first_slips(op, best, leads)
    step = step_of(op.u)
    band = best.band
    # a stick band beyond OP's span never turns
    widest_band = max(1.005 * band, min(1.0, (1.0 + _AROUND) * band))
    box = np.array([(1.0 - _AROUND) * band, widest_band, _LEAST_JUMP * band, widest_band])
    regions, at = np.tile(box, (starts.size, 1)), np.arange(starts.size)
    for stage, length in enumerate(_lengths(op, best)):
        part = op if length == op.u.size else op_of(op.u[:length])
        least = step * np.array([_STEPS[min(stage, len(_STEPS) - 1)], _STEP_OF_JUMP])
        widest = band * _WIDEST[min(stage, len(_WIDEST) - 1)]
        begun = np.column_stack([starts[at], np.full(at.size, best.first)])
        listed, _, of, cost = slip_patterns(
            part, likelihood.tables(length), regions, begun, least, widest, _MOST, exact=False
        )
        if of.size == 0:
            return None
        alive = _likely(likelihood.log(length, cost), op.u.size / length)
        if alive.size == 0:
            return None
        regions, at = listed[alive], at[of[alive]]
    found = _filled(op, likelihood, best.first, regions, feet[at], gaps[at])
    return reaching(op, likelihood, best, found)


def reaching(op: Op, likelihood: Likelihood, best: Candidate, found: Posterior) -> Posterior | None:
    """What was listed with another valve beside it; None where none of it comes near that one."""
    own = np.array([[best.band, best.jump, best.lead]])
    log, gain = _judged(op, likelihood, own, best.first)
    if found.log_likelihood.max() < log[0] - _LOST:
        return None
    return found.joined(Posterior(own, own[:, :2], own[:, :2], np.zeros(1), log, gain))


def cut_short(found: Posterior, middle: float, band: float) -> bool:
    """Whether a listing around ``band`` may hold likely valves that one around ``middle`` lacks."""
    if abs(band - middle) < _EDGE * middle:
        return False
    likely, side = found.interval(1.0, 0.0, _INSIDE), _AROUND - _EDGE
    return likely.low < (1.0 - side) * middle or likely.high > (1.0 + side) * middle


def judged_again(op: Op, likelihood: Likelihood, first: float, found: Posterior) -> Posterior:
    """The same valves under another likelihood; ``first`` is the direction of their first slips."""
    log, gain = _judged(op, likelihood, found.nodes, first)
    return replace(found, log_likelihood=log, gain=gain)


def _likely(log: Array, shorter: float) -> Index:
    """Boxes that stay, by what they say of a part ``shorter`` than the window by this factor."""
    kept = int(_KEPT * shorter) if shorter > 1.0 else _LEFT
    found: Index = np.argsort(-log, kind="stable")[:kept]
    likely: Index = found[log[found] > log.max() - _DROP * math.sqrt(shorter)]
    return likely


def _first_slips(op: Op, best: Candidate, leads: Sequence[float]) -> tuple[Array, Array, Array]:
    """One lead for each first slip that is tried, the least such lead, and their range."""
    every = first_slips(op.u, best.first)
    if every.leads.size == 0:
        return np.array([best.lead]), np.array([best.lead]), np.array([1e-6])
    at = every.of(best.lead)
    near = range(max(0, at - _NEAR), min(at + _NEAR + 1, every.leads.size))
    tried = sorted({*near, *(every.of(lead) for lead in leads)})
    return every.leads[tried], every.feet[tried], every.gaps[tried]


def _lengths(op: Op, best: Candidate) -> list[int]:
    """Samples that are looked at, stage by stage: the first slips, then more, then all."""
    at, _ = slips(op, best.band, best.jump, best.lead, best.first)
    n = op.u.size
    length = int(at[min(_FIRST, at.size - 1)]) + n // 50
    found = []
    while length < _LAST * n:
        found.append(length)
        length = int(_GROWTH * length)
    return [*found, n]


def _filled(
    op: Op, likelihood: Likelihood, first: float, regions: Array, feet: Array, gaps: Array
) -> Posterior:
    """Several slip jumps and leads of each box."""
    each = _LEADS * _JUMPS
    low, high = (
        np.repeat(regions[:, [0, 2]], each, axis=0),
        np.repeat(regions[:, [1, 3]], each, axis=0),
    )
    high[:, 1] = np.minimum(high[:, 1], high[:, 0])
    part = np.tile(np.arange(_JUMPS) / _JUMPS, _LEADS * regions.shape[0])
    width = (high[:, 1] - low[:, 1]) / _JUMPS
    low[:, 1] += part * _JUMPS * width
    high[:, 1] = low[:, 1] + width
    inside = np.tile(np.repeat((np.arange(_LEADS) + 0.5) / _LEADS, _JUMPS), regions.shape[0])
    gap = np.repeat(gaps, each)
    lead = np.repeat(feet, each) + inside * gap
    nodes = np.column_stack([high[:, 0], 0.5 * (low[:, 1] + high[:, 1]), lead])
    log, gain = _judged(op, likelihood, nodes, first)
    volume = np.maximum((high[:, 0] - low[:, 0]) * width * gap, 0.0)
    return Posterior(nodes, low, high, volume, log, gain)


def _judged(op: Op, likelihood: Likelihood, nodes: Array, first: float) -> tuple[Array, Array]:
    """Log-likelihoods and gains of valves over the whole window."""
    n = op.u.size
    cost, gain = one_step_costs(op, likelihood.tables(n), np.ascontiguousarray(nodes), first)
    return likelihood.log(n, cost), gain
