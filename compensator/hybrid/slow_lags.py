"""A lag so slow that a plan never sees it settle is a level, whatever an identification calls it.

Within a window a level and a lag of many hundred samples look alike, and identification takes the
one for the other. Planned as a lag, PV is trusted to come to rest by itself, with a gain that the
window never showed: an unknown load then counts a thousand times the noise, and the stem waits
while PV drifts.
"""

from __future__ import annotations

import math
from dataclasses import replace

from loop_model import ProcessModel

__all__ = ["as_planned"]

_STEPS = 50
"""Newton steps at most; from 1 they settle in fewer than ten."""


def as_planned(process: ProcessModel, longest: float) -> ProcessModel:
    """Return a process with its slowest lag taken for an integration, if it is a real one longer
    than ``longest`` samples; else the process itself.

    The first answer to OP stays what it is. The intercept is that of rest at OP 50: a filter finds
    the load anyhow.
    """
    if process.is_integrating:
        return process
    slowest = _slowest_pole(process.a)
    if math.isnan(slowest) or slowest <= math.exp(-1.0 / longest):
        return process
    quotient, others = 1.0, [1.0]
    for coefficient in process.a[:-1]:
        quotient = coefficient + slowest * quotient
        others.append(quotient)
    # Multiplied by z - 1 instead of z - slowest.
    pairs = zip(others, [*others[1:], 0.0], strict=True)
    a = tuple(after - before for before, after in pairs)
    return replace(process, a=a, offset=-50.0 * math.fsum(process.b))


def _slowest_pole(a: tuple[float, ...]) -> float:
    """Return the pole that Newton's method comes to from 1, NaN if to none between 0 and 1."""
    pole = 1.0
    for _ in range(_STEPS):
        value, slope = 1.0, 0.0
        for coefficient in a:
            slope = value + slope * pole
            value = coefficient + value * pole
        if slope <= 0.0:
            return math.nan
        step = value / slope
        pole -= step
        if abs(step) < 1e-14:
            return pole if 0.0 < pole < 1.0 else math.nan
    return math.nan
