"""How surely a hypothesis knows its gain."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from estimator.algebra import dot, filter_rows, orthonormal, project_out
from estimator.arrays import Array
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.linear_fit import delay
from estimator.processes.poles import Poles, Shape

__all__ = ["NUDGE", "gain_deviations", "gain_variance", "pole_derivatives", "straightened"]

NUDGE = 0.02
"""Step of log time constants for the derivative of a response."""


def pole_derivatives(of: Hypothesis) -> Array:
    """Change of the response with each time constant, ``(k, n)``."""
    own = of.poles.response(of.stem)
    found = []
    for name in ("slow", "fast", "third"):
        value = getattr(of.poles, name)
        if value <= 0.0 or (of.poles.integrating and name == "slow"):
            continue
        if of.poles.shape is Shape.SWINGING and name == "fast":
            value = min(value, 0.95)
        nudged: Poles = replace(of.poles, **{name: value * (1.0 + NUDGE)})
        found.append(delay(nudged.response(of.stem) - own, of.dead_time))
    return np.stack(found) if found else np.empty((0, own.size))


def straightened(case: Case, of: Hypothesis) -> Hypothesis:
    """The hypothesis with the straight characteristic that comes nearest to its curved one.

    A controller's model has one gain; the columns of the curve hold part of it, and of the offset.
    """
    if of.outside == of.nuisances:
        return of
    return case.fit(
        of.valve, of.poles, of.dead_time, of.outside, of.taps, refit_noise=False, stem=of.stem
    )


def gain_variance(case: Case, of: Hypothesis) -> float:
    """Variance of the scaled gain by least squares, poles free to first order, or inf."""
    response = delay(of.poles.response(of.stem), of.dead_time)
    others = np.vstack(
        [case.columns(of.nuisances, of.stem, of.poles, of.dead_time), pole_derivatives(of)]
    )
    basis = orthonormal(filter_rows(others, of.taps, case.rows.weight))
    left = project_out(filter_rows(response[None], of.taps, case.rows.weight)[0], basis)
    energy = float(dot(left, left))
    return of.squares / case.rows.count / energy if energy > 0.0 else math.inf


def gain_deviations(case: Case, of: Hypothesis) -> float:
    """The gain over its standard deviation, not negative: whether it is told from zero."""
    straight = straightened(case, of)
    deviation = math.sqrt(gain_variance(case, straight))
    return abs(straight.gain) / deviation if deviation > 0.0 else math.inf
