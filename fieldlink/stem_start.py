"""Where a stem stood before the first sample of a curve, as PV tells it.

Where the stick band is near OP's swing this decides the whole course: from a wrong place the
simulated stem rests for ever while the true one slips in every half cycle.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["likeliest_start"]

Array = NDArray[np.float64]

STARTS = 9
"""Places of the stem that are tried, from one end of the slack to the other: a quarter of the
static friction apart, which is less than a usual slip."""

CLEAR = 10.0
"""Log-likelihood by which the moving stem has to explain PV better than one at rest: the log Bayes
factor from which a verdict counts."""

ROUNDING = 1e-20
"""Share of PV's sum of squares below which an error is that of arithmetic."""


def likeliest_start(
    simulate: Callable[[float], Array], op: Array, pv: Array, *, stick_band: float, slip_jump: float
) -> float | None:
    """Return the place with which the stem explains PV best.

    Args:
        simulate: gives the stem for every sample, shape ``(n,)``, from the place before the first.
        op: shape ``(n,)``, without NaN; not empty.
        pv: shape ``(n,)``, NaN where it is missing.
        stick_band, slip_jump: S and J of the valve, in units of OP.

    Returns:
        The place in units of OP: the first OP where PV does not tell, because little happens. None
        where OP swings by more than the stick band and no place explains PV: the stem certainly
        turned there, unlike the simulated one.
    """
    static_friction = 0.5 * (stick_band + slip_jump)
    starts = op[0] + static_friction * np.linspace(-1.0, 1.0, STARTS)
    errors = [_error_of(simulate(float(start)), pv) for start in starts]
    best = int(np.argmin(errors))
    at_rest = _error_of(np.full(op.size, op[0]), pv)
    rows = np.count_nonzero(np.isfinite(pv))
    least = ROUNDING * float(np.nansum(pv**2))
    if not at_rest > least:
        return float(op[0])
    if 0.5 * rows * math.log(at_rest / max(errors[best], least)) >= CLEAR:
        return float(starts[best])
    return None if np.ptp(op) > stick_band else float(op[0])


def _error_of(stem: Array, pv: Array) -> float:
    """Sum of squared errors of PV, each from the PV and the stems before it; 0 with too few."""
    columns = np.column_stack([pv[1:-1], stem[1:-1], stem[:-2], np.ones(max(pv.size - 2, 0))])
    good = np.isfinite(columns).all(axis=1) & np.isfinite(pv[2:])
    if np.count_nonzero(good) <= columns.shape[1]:
        return 0.0
    known, wanted = columns[good], pv[2:][good]
    found = np.linalg.lstsq(known, wanted, rcond=None)[0]
    return float(np.sum((wanted - known @ found) ** 2))
