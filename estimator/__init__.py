"""Valve stiction from OP and PV: arrays in, result out.

from estimator import identify
result = identify(op, pv, period=1.0)
result.verdict, result.stick_band, result.reasons
"""

from estimator.identification import identify, warm_up
from estimator.outcomes import EstimatorError, Reason, ReasonCode, Verdict
from estimator.result import CostSurface, Identification, Interval

__all__ = [
    "CostSurface",
    "EstimatorError",
    "Identification",
    "Interval",
    "Reason",
    "ReasonCode",
    "Verdict",
    "identify",
    "warm_up",
]
