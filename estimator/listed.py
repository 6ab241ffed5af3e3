"""All valves that explain a window about as well as the best one: sets of slips, listed.

Valves that slip at the same samples fill a box in stick band and slip jump (`estimator._slips`).
The boxes of a wide surrounding are listed for the first slips of the window, those far less likely
than the best are dropped, and the others are listed further as the window grows: so distant peaks
of the likelihood are found that no climb from the best valve would see, for the price of some
thousand evaluations.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from estimator._kernels import Array, Index
from estimator._listing import slip_patterns
from estimator._slips import Op, first_leads, op_of, slips, step_of
from estimator.candidate import Candidate
from estimator.posterior import Posterior

__all__ = ["listed_posterior"]

Likelihood = Callable[[Op, Array, float], tuple[Array, Array]]
"""The first samples of OP, nodes ``(m, 3)`` of S, J and lead, and the direction of the first slip,
to log-likelihood and gain, ``(m,)`` each."""

_AROUND = 0.15
"""How far in S is listed, as a share of it; J from nothing to all."""
_LEAST_JUMP = 0.02
_NEAR = 3
"""First slips tried around that of the best valve, each way."""
_FIRST, _GROWTH = 8, 2.2
_STEPS = (0.12, 0.05, 0.02, 0.01)
"""Sets of slips are told apart down to these shares of OP's step per sample, stage by stage."""
_WIDEST = (0.15, 0.1, 0.07, 0.05)
"""The widest box in J, as a share of S."""
_DROP, _LOST = 14.0, 3.0
_MOST, _KEPT = 30_000, 600
_LEADS, _JUMPS = 2, 3
"""Valves tried in each box that is left."""


def listed_posterior(op: Op, likelihood: Likelihood, best: Candidate) -> Posterior | None:
    """The likelihood around a valve of the search, anchored (`Candidate.anchored`).

    None where the sets of slips are too many to be listed finely: none comes near to the valve.
    """
    starts, feet, gaps = _first_slips(op, best)
    step = step_of(op.u)
    band = best.band
    # a stick band beyond OP's span never turns
    widest_band = max(1.005 * band, min(1.0, (1.0 + _AROUND) * band))
    box = np.array([(1.0 - _AROUND) * band, widest_band, _LEAST_JUMP * band, widest_band])
    regions, at = np.tile(box, (starts.size, 1)), np.arange(starts.size)
    for stage, length in enumerate(_lengths(op, best)):
        part = op if length == op.u.size else op_of(op.u[:length])
        least = step * np.array([_STEPS[min(stage, len(_STEPS) - 1)], 0.3])
        widest = band * _WIDEST[min(stage, len(_WIDEST) - 1)]
        leads = np.column_stack([starts[at], np.full(at.size, best.first)])
        found, of = slip_patterns(part, regions, leads, least, widest, _MOST)
        if of.size == 0:
            return None
        jump = np.minimum(0.5 * (found[:, 2] + found[:, 3]), found[:, 1])
        nodes = np.ascontiguousarray(np.column_stack([found[:, 1], jump, leads[of, 0]]))
        log, _ = likelihood(part, nodes, best.first)
        alive = _most_likely(log)
        if alive.size == 0:
            return None
        regions, at = found[alive], at[of[alive]]
    posterior = _filled(op, likelihood, best, regions, feet[at], gaps[at])
    log = posterior.log_likelihood
    return None if log[:-1].max() < log[-1] - _LOST else posterior


def _most_likely(log: Array) -> Index:
    found: Index = np.argsort(-log, kind="stable")[:_KEPT]
    likely: Index = found[log[found] > log.max() - _DROP]
    return likely


def _first_slips(op: Op, best: Candidate) -> tuple[Array, Array, Array]:
    """One lead for each first slip near that of ``best``, the least such lead, and their range."""
    leads = first_leads(op.u, best.first)
    if leads.size == 0:
        return np.array([best.lead]), np.array([best.lead]), np.array([1e-6])
    records = np.unique(np.maximum.accumulate(best.first * (op.u - op.u[0])))
    at = int(np.searchsorted(leads, best.lead))
    near = slice(max(0, at - _NEAR), at + _NEAR + 1)
    return leads[near], records[:-1][near], np.diff(records)[near]


def _lengths(op: Op, best: Candidate) -> list[int]:
    """Samples that are looked at, stage by stage: the first slips, then more, then all."""
    at, _ = slips(op, best.band, best.jump, best.lead, best.first)
    n = op.u.size
    length = int(at[min(_FIRST, at.size - 1)]) + n // 50
    found = []
    while length < n // 2:
        found.append(length)
        length = int(_GROWTH * length)
    return [*found, n]


def _filled(
    op: Op, likelihood: Likelihood, best: Candidate, regions: Array, feet: Array, gaps: Array
) -> Posterior:
    """Several slip jumps and leads of each box, the best valve with them."""
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
    own = np.array([best.band, best.jump, best.lead])
    nodes = np.ascontiguousarray(np.vstack([nodes, own]))
    log, gain = likelihood(op, nodes, best.first)
    volume = np.append((high[:, 0] - low[:, 0]) * width * gap, 0.0)
    low, high = np.vstack([low, own[:2]]), np.vstack([high, own[:2]])
    return Posterior(nodes, low, high, np.maximum(volume, 0.0), log, gain)
