"""Intervals: the likelihood over (S, J) around its maximum, everything else at its best.

The likelihood in S and J is no parabola: the valve slips at a sample or it does not, so it has
plateaus and steps. Intervals are therefore read off the area under the likelihood (a uniform weight
over the triangle ``0 <= J <= S``), not off a fixed drop below its maximum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator._kernels import Array, Mask
from estimator.regression import Regression
from estimator.result import Interval
from estimator.search import Candidate, stem_of

__all__ = ["Profile", "likelihood_profile", "quantile_interval"]

_NODES = 17
_PASSES = 7
_DROP = 8.0


@dataclass(frozen=True, slots=True)
class Profile:
    """Log-likelihood over nodes ``(band, jump)``, shape ``(m,)`` each, zero at the maximum.

    ``gain`` is the linear part's gain at each node.
    """

    band: Array
    jump: Array
    log_likelihood: Array
    gain: Array
    best: Candidate


def likelihood_profile(
    u: Array, regression: Regression, best: Candidate, samples: float
) -> Profile:
    """Profile around ``best``, zoomed to where the likelihood is; ``samples`` are effective ones."""
    box = (0.0, 1.1, 0.0, 1.1)
    nodes = _evaluate(u, regression, best, samples, box)
    for _ in range(_PASSES):
        alive = nodes.log_likelihood > -_DROP
        narrowed = _around(nodes, alive, box)
        shrink = (narrowed[1] - narrowed[0]) / (box[1] - box[0])
        shrink = min(shrink, (narrowed[3] - narrowed[2]) / (box[3] - box[2]))
        box = narrowed
        nodes = _evaluate(u, regression, nodes.best, samples, box)
        if shrink > 0.8:
            break
    return nodes


def quantile_interval(value: float, nodes: Array, log_weight: Array, confidence: float) -> Interval:
    """Interval that holds ``confidence`` of the weight, equal tails; it always holds ``value``."""
    order = np.argsort(nodes, kind="stable")
    sorted_nodes = nodes[order]
    weight = np.exp(log_weight[order] - log_weight.max())
    cumulative = np.cumsum(weight) - 0.5 * weight
    cumulative /= weight.sum()
    tail = 0.5 * (1.0 - confidence)
    low, high = np.interp([tail, 1.0 - tail], cumulative, sorted_nodes)
    return Interval(value, min(float(low), value), max(float(high), value))


def _evaluate(
    u: Array,
    regression: Regression,
    best: Candidate,
    samples: float,
    box: tuple[float, float, float, float],
) -> Profile:
    bands = np.linspace(box[0], box[1], _NODES)
    jumps = np.linspace(box[2], box[3], _NODES)
    band, jump = (g.ravel() for g in np.meshgrid(bands, jumps, indexing="ij"))
    inside = (jump <= band) & (band > 0.0)
    band, jump = np.append(band[inside], best.band), np.append(jump[inside], best.jump)
    starts = np.unique(np.clip(best.start + np.array([-0.3, -0.1, 0.0, 0.1, 0.3]), -1.0, 1.0))
    wide_band, wide_jump = np.tile(band, starts.size), np.tile(jump, starts.size)
    start = np.repeat(starts, band.size)
    stem = regression.whiten(stem_of(u, wide_band, wide_jump / wide_band, start))
    cost, gain = regression.cost_and_gain(stem, best.structure, best.dead_time)
    cost, gain = cost.reshape(starts.size, -1), gain.reshape(starts.size, -1)
    pick = cost.argmin(axis=0)
    index = np.arange(band.size)
    least, gains = cost[pick, index], gain[pick, index]
    i = int(least.argmin())
    if least[i] < best.cost:
        best = Candidate(
            float(least[i]),
            float(band[i]),
            float(jump[i] / band[i]),
            float(starts[pick[i]]),
            best.structure,
            best.dead_time,
        )
    log_likelihood = -0.5 * samples * np.log(least / least.min())
    return Profile(band, jump, log_likelihood, gains, best)


def _around(
    nodes: Profile, alive: Mask, box: tuple[float, float, float, float]
) -> tuple[float, float, float, float]:
    step_band = (box[1] - box[0]) / (_NODES - 1)
    step_jump = (box[3] - box[2]) / (_NODES - 1)
    band, jump = nodes.band[alive], nodes.jump[alive]
    return (
        max(0.0, float(band.min()) - step_band),
        float(band.max()) + step_band,
        max(0.0, float(jump.min()) - step_jump),
        float(jump.max()) + step_jump,
    )
