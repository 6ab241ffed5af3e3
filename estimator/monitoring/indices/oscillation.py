"""Is there an oscillation, how long is its period and how regular is it?"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estimator.monitoring.indices._signals import correlation, crossings, detrended, vector

__all__ = ["Oscillation", "oscillation"]

_INTERVALS = 10
_LEAST_INTERVALS = 4


@dataclass(frozen=True, slots=True)
class Oscillation:
    """What the zero crossings of the autocorrelation say.

    Attributes:
        period_s: mean period in seconds; NaN when there are too few crossings to tell.
        regularity: ``T / (3 sigma_T)``; above 1 the oscillation is regular. Infinite for an
            oscillation without any spread, 0 when there are too few crossings.
        intervals: intervals between crossings that were used, ten at most.
    """

    period_s: float
    regularity: float
    intervals: int

    @property
    def is_regular(self) -> bool:
        """Whether there is a regular oscillation."""
        return self.regularity > 1.0


def oscillation(values: ArrayLike, *, period: float = 1.0) -> Oscillation:
    """Period and regularity of an oscillation from the autocorrelation's zero crossings.

    Noise hardly harms the autocorrelation beyond lag zero, which is why its crossings are used and
    not the signal's. A signal with two oscillations must be filtered first.

    Args:
        values: samples, shape ``(n,)``, NaN where bad; usually the control error or PV.
        period: seconds between samples.

    Raises:
        EstimatorError: not a vector, or too few usable samples.

    Source: Thornhill, Huang and Zhang (2003), "Detection of multiple oscillations in control
    loops", Journal of Process Control 13, 91-100.
    """
    centred = detrended(vector("values", values))
    lags, acf = correlation(centred, centred)
    at = crossings(acf[lags >= 0])[: _INTERVALS + 1]
    intervals = np.diff(at)
    if intervals.size < _LEAST_INTERVALS:
        return Oscillation(math.nan, 0.0, int(intervals.size))
    mean = 2.0 * float(intervals.mean())
    spread = 2.0 * float(intervals.std(ddof=1))
    regularity = math.inf if spread == 0.0 else mean / (3.0 * spread)
    return Oscillation(mean * period, regularity, int(intervals.size))
