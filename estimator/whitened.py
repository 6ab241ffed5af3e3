"""The simulation model with its noise whitened: the test that a wandering disturbance must fail.

A simulation error is correlated, and a slow disturbance that OP compensates looks like a valve that
does not follow OP. Given an autoregression of its own, a healthy valve explains such a window as
well as a sticky one; what is left then are the slips, which no linear noise predicts. The dead time
is one sample or more here: with direct feed-through the noise model may learn the controller.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from estimator._kernels import Array
from estimator._slips import Op
from estimator.candidate import Candidate
from estimator.noise import autoregression
from estimator.regression import Regression
from estimator.search import followed, healthy_refined

__all__ = ["noise_left", "whitened_bic"]

_ORDER = 8
_ROUNDS = 3
_VALVE_PARAMETERS = 3


def noise_left(
    regression: Regression, used: Regression, stem: Array, candidate: Candidate, most: int
) -> tuple[Array, float]:
    """Noise filter, of ``most`` past samples at most, and innovation variance of what a process
    leaves of PV; its linear part is fitted under the filter of ``used``."""
    fit = used.solve(stem, candidate.structure, candidate.dead_time)
    error = np.where(regression.weight > 0.0, regression.y - fit.prediction, 0.0)
    return autoregression(error, regression.weight, most)


def whitened_bic(op: Op, regression: Regression, found: Candidate, *, healthy: bool) -> float:
    """BIC of the innovations of the simulation model ``found`` with autoregressive noise.

    Model and noise are refitted in turn (generalised least squares); the lowest BIC of the rounds
    is returned. ``op`` is the scaled OP; ``healthy`` takes the stem to be OP.
    """
    candidate = replace(found, dead_time=max(1, found.dead_time))
    # a sinusoid's frequency is a parameter as well
    extra = regression.extra.shape[0] + (1 if regression.extra.size else 0)
    used = regression
    lowest = math.inf
    for last in (*([False] * _ROUNDS), True):
        stem = op.u if healthy else candidate.stem(op)
        taps, variance = noise_left(regression, used, stem, candidate, _ORDER)
        free = taps.size - 1 + candidate.structure.free + extra
        free += 0 if healthy else _VALVE_PARAMETERS
        count = regression.count
        lowest = min(lowest, count * math.log(variance) + free * math.log(count))
        if last:
            break
        used = Regression(regression.y, regression.good, taps, 1, regression.extra)
        candidate = (
            healthy_refined(op, used, candidate) if healthy else followed(op, used, candidate)
        )
    return lowest
