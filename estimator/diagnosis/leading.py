"""Who leads in a group: whose past tells more of the others than their own past does.

Source: Granger (1969), "Investigating causal relations by econometric models and cross-spectral
methods", Econometrica 37, 424-438; for loops of a plant Yuan and Qin (2014), "Root cause diagnosis
of plant-wide oscillations using Granger causality", Journal of Process Control 24, 450-459.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import scipy

from estimator.arrays import Array
from estimator.diagnosis.settings import Grouping

__all__ = ["chance_of_lead", "leads"]


def leads(signals: Mapping[str, Array], grouping: Grouping) -> dict[str, float]:
    """For each signal how far it leads the others, from -1 (follows all) to 1 (leads all).

    ``signals`` are ``(n,)`` on one grid of times, NaN where bad.
    """
    names = list(signals)
    found = dict.fromkeys(names, 0.0)
    if len(names) < 2:
        return found
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            there = _gain(signals[one], signals[other], grouping.order)
            back = _gain(signals[other], signals[one], grouping.order)
            towards = math.tanh((there - back) / grouping.lead_nats)
            found[one] += towards
            found[other] -= towards
    return {name: value / (len(names) - 1) for name, value in found.items()}


def chance_of_lead(source: Array, target: Array, grouping: Grouping) -> float:
    """Logarithm of the probability that a signal tells as much of another's future by chance.

    Both are ``(n,)`` on one grid, NaN where bad. Twice the gain in likelihood is chi-squared then
    (Wilks 1938), whatever the spectra: each signal's own past is accounted for.
    """
    gain = _gain(source, target, grouping.order)
    return float(scipy.stats.chi2.logsf(2.0 * gain, grouping.order)) if math.isfinite(gain) else 0.0


def _gain(source: Array, target: Array, order: int) -> float:
    """Nats by which the source's past improves the prediction of the target from its own past."""
    n = target.size
    own = np.stack([target[order - i - 1 : n - i - 1] for i in range(order)], axis=1)
    past = np.stack([source[order - i - 1 : n - i - 1] for i in range(order)], axis=1)
    goal = target[order:]
    good = np.isfinite(own).all(axis=1) & np.isfinite(past).all(axis=1) & np.isfinite(goal)
    rows = int(good.sum())
    if rows < 6 * order:
        return 0.0
    ones = np.ones((rows, 1))
    short = np.hstack([own[good], ones])
    long = np.hstack([short, past[good]])
    squares = []
    for design in (short, long):
        rest = goal[good] - design @ np.linalg.lstsq(design, goal[good], rcond=None)[0]
        squares.append(max(float(rest @ rest), 1e-300))
    return 0.5 * rows * math.log(squares[0] / squares[1])
