"""The posterior of the valve: samples with weights, from which every interval and sentence comes.

The likelihood over S, J and the first position is sampled under every law that explains the window
nearly as well as the best one (adaptive importance sampling: Cornuet, Marin, Mira and Robert,
Adaptive multiple importance sampling, Scand. J. Statist. 39, 2012). The process is free: gain and
columns are solved for every sample, dead time is at its best, and poles may move to first order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from compiled import kernel
from estimator.algebra import cholesky
from estimator.arrays import Array
from estimator.hypotheses.gain import pole_derivatives
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.processes.poles import coefficients
from estimator.result import Interval
from estimator.search.descent import moved_valves, turned_points
from estimator.valves.laws import LAWS

__all__ = ["Peak", "Posterior", "sample_posterior"]

_IMPOSSIBLE = 1e6
"""Nats by which a stem that does not work like a valve is behind."""
_ALIKE = 0.05
"""Stems that differ by less, as a share of S, are those of one law."""
_PARTS = ndtri((np.arange(9) + 0.5) / 9.0)
"""Nine equal parts of a normal distribution."""


@dataclass(frozen=True, slots=True)
class Peak:
    """One valve that explains the window, with its share of the probability."""

    band: float
    jump: float
    share: float


@dataclass(frozen=True, slots=True)
class Posterior:
    """Weighted valves ``(m, 3)`` (S, J and first position), weights ``(m,)`` that sum to one.

    Attributes:
        samples, weights: the samples, in scaled units.
        blur: standard deviations of S and J that the model itself leaves, as shares of OP's span.
    """

    samples: Array
    weights: Array
    blur: tuple[float, float]

    @property
    def valves(self) -> Array:
        """S and J of every sample, ``(m, 2)``."""
        return self.samples[:, :2]

    def interval(self, of_band: float, of_jump: float, confidence: float) -> Interval:
        """Equal-tailed interval of ``of_band S + of_jump J``, its value the median."""
        values = self.valves @ np.array([of_band, of_jump])
        blur = math.hypot(of_band * self.blur[0], of_jump * self.blur[1])
        rising = np.argsort(values, kind="stable")
        # Runs in rising order, which a stable sort only has to merge.
        spread = (values[rising] + blur * _PARTS[:, None]).ravel()
        weight = np.tile(self.weights[rising] / _PARTS.size, _PARTS.size)
        order = np.argsort(spread, kind="stable")
        share = np.cumsum(weight[order]) - 0.5 * weight[order]
        tail = 0.5 * (1.0 - confidence)
        low, middle, high = np.interp([tail, 0.5, 1.0 - tail], share, spread[order])
        return Interval(float(middle), float(low), float(high))

    def peaks(self, apart: float = 0.05, share: float = 0.1) -> tuple[Peak, ...]:
        """Valves whose stick bands are apart, each with at least a ``share``; likeliest first."""
        alive = np.flatnonzero(self.weights > 1e-4)
        order = alive[np.argsort(self.valves[alive, 0], kind="stable")]
        band = self.valves[order, 0]
        found = []
        for part in np.split(order, 1 + np.flatnonzero(np.diff(band) > apart * band[1:])):
            mass = float(self.weights[part].sum())
            if mass >= share:
                top = part[int(self.weights[part].argmax())]
                found.append(Peak(float(self.valves[top, 0]), float(self.valves[top, 1]), mass))
        return tuple(sorted(found, key=lambda peak: -peak.share))


def sample_posterior(case: Case, explanations: tuple[Hypothesis, ...]) -> Posterior:
    """The posterior around the sticky hypotheses, one a law, the likeliest first."""
    spreading = case.settings.spreading
    best = explanations[0]
    assert best.valve is not None
    valves, weights = [], []
    for one in explanations:
        behind = best.likelihood - one.likelihood
        if behind > spreading.law_nats:
            continue
        found, log_weight = _sample(case, one)
        weight = np.exp(log_weight - log_weight.max())
        valves.append(found)
        # a law that is a little behind may still be that of the valve: no law is quite
        weights.append(weight / weight.sum() * math.exp(-spreading.law_temper * behind))
    weight = np.concatenate(weights)
    # A real valve slips between two samples, anywhere: the deviation of a uniform distribution.
    late = _usual_step(case.rows.u) / math.sqrt(12.0)
    band = best.valve.band
    doubt = math.exp(-_lead_of_law(explanations) / spreading.lead)
    blur = tuple(
        math.hypot(late, band * (known + doubt * (open_ - known)))
        for known, open_ in (spreading.law, spreading.law_jump)
    )
    return Posterior(np.vstack(valves), weight / weight.sum(), (blur[0], blur[1]))


def _lead_of_law(explanations: tuple[Hypothesis, ...]) -> float:
    """Nats by which the likeliest law is ahead of the next one; 0 where only one was tried.

    Laws that move the stem alike are one: ``he`` and ``steps`` where no sample asks for two slips.
    """
    best = explanations[0]
    assert best.valve is not None
    others = [
        one.likelihood
        for one in explanations
        if one.valve is not None
        and one.valve.law != best.valve.law
        and float(np.abs(one.stem - best.stem).max()) > _ALIKE * best.valve.band
    ]
    return best.likelihood - max(others) if others else 0.0


def _usual_step(op: Array) -> float:
    steps = np.abs(np.diff(op))
    moving = steps[steps > 0.0]
    return float(np.median(moving)) if moving.size else 0.0


def _sample(case: Case, of: Hypothesis) -> tuple[Array, Array]:
    """Valves and log weights of one law's samples."""
    spreading = case.settings.spreading
    valve = of.valve
    assert valve is not None
    columns = np.vstack(
        [
            case.columns(of.nuisances, of.stem, of.poles, of.dead_time),
            pole_derivatives(of),
        ]
    )
    design = case.design_of(columns, of.taps)
    row = np.array([[of.poles.slow, of.poles.fast, of.poles.third]])
    process = np.repeat(coefficients(of.poles.shape, row), spreading.lanes, axis=1)
    shortest = max(0, of.dead_time - 1)
    count = min(3, case.max_dead_time + 1 - shortest)
    centre = np.array([valve.band, valve.jump, valve.start])
    # a sample that a historian drew says nothing of its own
    temper = spreading.temper * case.rows.informed
    middle, root = np.zeros(3), np.diag(np.array(spreading.reach))
    tables, likelihoods, proposals = [], [], []
    for turn in range(spreading.rounds):
        points = turned_points(spreading.lanes, 3, turn)
        table = middle + points @ root.T
        if turn == 0:
            table[0] = 0.0
        stems = LAWS[valve.law](case.rows.u, moved_valves(centre, table))
        costs = design.paired(stems, process, shortest, count).min(axis=0)
        tables.append(table)
        likelihood = -temper * case.worth(costs)
        # never minus infinity for all: the valve itself is among them
        likelihoods.append(np.where(case.tells(stems), likelihood, likelihood - _IMPOSSIBLE))
        proposals.append((middle, root))
        every = np.vstack(tables)
        log_like = np.concatenate(likelihoods)
        middles, roots = (np.stack(part) for part in zip(*proposals, strict=True))
        log_weight = log_like - _log_mixture(every, middles, roots)
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        middle = weight @ every
        apart = every - middle
        spread = (apart * weight[:, None]).T @ apart
        # wider than what was found: a proposal that is too narrow never finds out
        floor = np.diag(np.square(spreading.narrowest * np.ones(3)))
        root = cholesky(spreading.wider**2 * spread + floor)
    valves = moved_valves(centre, every)
    return valves, log_weight


@kernel
def _log_mixture(points: Array, middles: Array, roots: Array) -> Array:
    """Log density (up to a constant) of an equal mixture of normal distributions, ``(m,)``.

    At points ``(m, w)``; of means ``(p, w)`` and lower factors ``(p, w, w)`` of covariances.
    """
    m, wide = points.shape
    count = middles.shape[0]
    out = np.empty(m)
    logs, scaled = np.empty(count), np.empty(wide)
    for k in range(m):
        for p in range(count):
            total = 0.0
            for i in range(wide):
                left = points[k, i] - middles[p, i]
                for c in range(i):
                    left -= roots[p, i, c] * scaled[c]
                scaled[i] = left / roots[p, i, i]
                total -= 0.5 * scaled[i] * scaled[i] + math.log(roots[p, i, i])
            logs[p] = total
        top = logs.max()
        out[k] = top + math.log(np.exp(logs - top).sum() / count)
    return out
