"""Indices that practitioners know, as evidence beside a verdict and never the verdict itself.

    swing = oscillation(pv - sp, period=10.0)      # period and regularity
    horch = cross_correlation(op, pv)              # odd: the valve; even: tuning or outside
    width = apparent_stiction(op, pv)              # width of the PV(OP) ellipse
    share = harris_index(pv - sp, dead_time=3)     # 1 is minimum variance
    wear = valve_wear(op, period=10.0)             # travel and reversals a day

All take arrays of shape ``(n,)``; a NaN marks a bad sample and counts for nothing.
"""

from estimator.monitoring.indices.correlation import (
    CrossCorrelation,
    HorchFinding,
    cross_correlation,
)
from estimator.monitoring.indices.ellipse import Ellipse, apparent_stiction
from estimator.monitoring.indices.harris import harris_index
from estimator.monitoring.indices.oscillation import Oscillation, oscillation
from estimator.monitoring.indices.wear import ValveWear, valve_wear

__all__ = [
    "CrossCorrelation",
    "Ellipse",
    "HorchFinding",
    "Oscillation",
    "ValveWear",
    "apparent_stiction",
    "cross_correlation",
    "harris_index",
    "oscillation",
    "valve_wear",
]
