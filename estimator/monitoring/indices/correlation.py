"""Horch's cross-correlation of OP and PV: odd points to the valve, even away from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from estimator.monitoring.indices._signals import correlation, crossings, detrended, pair

__all__ = ["CrossCorrelation", "HorchFinding", "cross_correlation"]

# A phase shift of less than pi/6 counts as even, of more than pi/3 as odd (Horch, 1999).
_EVEN_LAG, _ODD_LAG = 1.0 / 3.0, 2.0 / 3.0
_EVEN_HEIGHT = (2.0 - math.sqrt(3.0)) / (2.0 + math.sqrt(3.0))
_ODD_HEIGHT = 1.0 / 3.0


class HorchFinding(StrEnum):
    """What the symmetry of the cross-correlation says."""

    STICTION = "stiction"
    NO_STICTION = "no_stiction"
    UNDECIDED = "undecided"

    @property
    def advice(self) -> str:
        """What follows for the loop."""
        return {
            HorchFinding.STICTION: "The oscillation arises in the loop at the valve.",
            HorchFinding.NO_STICTION: "Look at the tuning or for an oscillation from outside.",
            HorchFinding.UNDECIDED: "The phase lies between; use other evidence.",
        }[self]


@dataclass(frozen=True, slots=True)
class CrossCorrelation:
    """Horch's two measures of asymmetry, both from 0 (even) to 1 (odd).

    Attributes:
        lag_asymmetry: ``|t_l - t_r| / (t_l + t_r)`` of the first crossings left and right of 0.
        height_asymmetry: ``|r_0 - r_opt| / |r_0 + r_opt|`` of lag 0 and the extreme between them.
    """

    lag_asymmetry: float
    height_asymmetry: float

    @property
    def finding(self) -> HorchFinding:
        """Both measures odd, both even, or undecided."""
        if self.lag_asymmetry > _ODD_LAG and self.height_asymmetry > _ODD_HEIGHT:
            return HorchFinding.STICTION
        if self.lag_asymmetry <= _EVEN_LAG and self.height_asymmetry <= _EVEN_HEIGHT:
            return HorchFinding.NO_STICTION
        return HorchFinding.UNDECIDED


def cross_correlation(op: ArrayLike, pv: ArrayLike) -> CrossCorrelation:
    """Asymmetry of the cross-correlation of OP and PV, for an oscillating self-regulating loop.

    The phase of a square-like stem lags OP by a quarter period, which makes the function odd.
    Horch's own limits of use hold: PI control, no integrating process, one dominant oscillation.

    Args:
        op, pv: samples, shape ``(n,)``, NaN where bad.

    Returns:
        The two measures; NaN (finding: undecided) when the function has no crossing on a side.

    Raises:
        EstimatorError: not vectors of one length, or too few usable samples.

    Source: Horch (1999), "A simple method for detection of stiction in control valves", Control
    Engineering Practice 7, 1221-1231.
    """
    u, y = pair(op, pv)
    lags, values = correlation(detrended(u), detrended(y))
    zero = int(np.flatnonzero(lags == 0)[0])
    right = crossings(values[zero:])
    left = crossings(values[zero::-1])
    at_zero = float(values[zero])
    if at_zero == 0.0 and right.size + left.size > 0:
        return CrossCorrelation(1.0, 1.0)
    if right.size == 0 or left.size == 0:
        return CrossCorrelation(math.nan, math.nan)
    between = values[zero - int(left[0]) : zero + int(right[0]) + 1] * math.copysign(1.0, at_zero)
    extreme = float(between.max())
    return CrossCorrelation(
        float(abs(left[0] - right[0]) / (left[0] + right[0])),
        (extreme - abs(at_zero)) / (extreme + abs(at_zero)),
    )
