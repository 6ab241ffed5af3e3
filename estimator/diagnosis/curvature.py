"""How much the gain from OP to PV changes over the range that a record covers, and where."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.explanations import Explained

__all__ = ["Curvature", "curvature_of"]

_MIDDLE = (0.05, 0.95)
"""Ends of the middle nine tenths of a signal."""
_MOST = 50.0
"""Largest logarithm of a ratio of gains: beyond, a gain is zero."""
_POINTS = 33
"""Points of PV's middle nine tenths at which the gain is computed."""


@dataclass(frozen=True, slots=True)
class Curvature:
    """How the gain changes.

    Attributes:
        over: the signal with which it changes: ``"OP"`` or ``"PV"``.
        ratio: the largest over the smallest gain within that signal's middle nine tenths.
        steepest: the largest over that of the identified process.
        where: where it is larger, in words.
    """

    over: str
    ratio: float
    steepest: float
    where: str


def curvature_of(explained: Explained | None, op: Array, pv: Array) -> Curvature | None:
    """The curvature of an explanation; None where its gain is the same everywhere.

    Args:
        explained: the explanations of a window of the record.
        op, pv: the whole record, ``(n,)``: its controller must do for all of it.
    """
    if explained is None:
        return None
    if (curve := explained.over_pv) is not None:
        low, high = np.quantile(pv, _MIDDLE)
        gains = -curve.log_slope(np.linspace(low, high, _POINTS))
        usual = -float(np.mean(curve.log_slope(pv)))
        where = "higher at high PV" if gains[-1] > gains[0] else "lower at high PV"
        if curve.is_arched:
            where = "highest in the middle of PV's range"
        return Curvature("PV", _exp(float(np.ptp(gains))), _exp(float(gains.max()) - usual), where)
    if explained.bend == 0.0:
        return None
    change = abs(explained.bend) * float(np.ptp(np.quantile(op, _MIDDLE)))
    where = "higher at high OP" if explained.bend > 0.0 else "lower at high OP"
    return Curvature("OP", _exp(change), _exp(0.5 * change), where)


def _exp(logarithm: float) -> float:
    return math.exp(min(_MOST, float(logarithm)))
