"""Whether the evidence is in all of the window: a valve that sticks does so all the time."""

from __future__ import annotations

import numpy as np

from estimator.algebra import filter_rows
from estimator.arrays import Array
from estimator.evidence.verdict import slips_of
from estimator.hypotheses.hypothesis import Case, Hypothesis

__all__ = ["steady_evidence"]


def steady_evidence(case: Case, healthy: Hypothesis, sticky: Hypothesis) -> float:
    """Log Bayes factor (nats) without the part of the window that holds most of it.

    One jump of the load, or one bridged gap, may fall on a slip of some valve and count for that
    valve. The window is cut into equal parts, each is left out in turn, and the least evidence
    counts. Nothing is fitted again but the size of the innovations; prices stay paid in full. Where
    all slips fall into one part's length, a stem at rest is left, which a load explains as well: 0
    at most.
    """
    parts = case.settings.judging.parts
    counts = np.array([part.sum() for part in np.array_split(case.rows.weight, parts)])
    left = case.rows.count - counts
    gained = 0.5 * left * (_log_sizes(case, healthy, left) - _log_sizes(case, sticky, left))
    whole = case.log_likelihood(sticky.squares) - case.log_likelihood(healthy.squares)
    prices = sticky.likelihood - healthy.likelihood - whole
    least = float(gained.min()) + prices
    slips = slips_of(sticky.stem)
    if slips.size and slips[-1] - slips[0] < case.rows.size / parts:
        return min(least, 0.0)
    return least


def _log_sizes(case: Case, of: Hypothesis, left: Array) -> Array:
    """Log of the innovations' variance without each part in turn, ``(parts,)``."""
    innovations = filter_rows(of.residual[None], of.taps, case.rows.weight)[0]
    squares = np.array([float(p.sum()) for p in np.array_split(np.square(innovations), left.size)])
    found: Array = np.log((squares.sum() - squares) / np.maximum(left, 1.0) + case.rows.floor)
    return found
