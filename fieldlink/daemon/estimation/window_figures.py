"""What a window shows beside its verdict: swing, travel, time in automatic, saturation, gaps.

Stored with every estimate under ``window``, so that the pages and reports need not read the samples
again. Imported only where the estimator runs.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator import EstimatorError
from estimator.monitoring.indices import oscillation, valve_wear
from fieldlink.daemon.windows.window import WindowData

__all__ = ["window_figures"]

Floats = NDArray[np.float64]

REGULAR = 1.0
"""Regularity from which an oscillation has a period: Thornhill, Huang and Zhang (2003)."""

AT_LIMIT = 1e-3
"""Share of OP's span within which a sample counts as lying at OP's highest or lowest value."""

LEAST_AT_LIMIT = 3
"""Samples in a row at one of these values that count as saturation: a turn of OP is one or two."""


def window_figures(window: WindowData, period: float) -> dict[str, float | None]:
    """Return the figures of a window; None where it does not tell.

    Args:
        window: the samples.
        period: plant seconds between them.

    Returns:
        ``swing_period_s``: period of a regular oscillation of the control error (of PV without a
        set-point); ``travel_per_day``, ``reversals_per_day``: of OP, per plant day; ``automatic``,
        ``saturated``: shares of the window; ``good``: share of slots with good OP and PV;
        ``pv_std``: standard deviation of the control error (of PV).
    """
    error = window.pv if window.sp is None else window.pv - window.sp
    usable = np.isfinite(error)
    try:
        swing = oscillation(error, period=period)
        wear = valve_wear(window.op, period=period)
    except EstimatorError:
        found: dict[str, float] = {}
    else:
        found = {
            "swing_period_s": swing.period_s if swing.regularity > REGULAR else math.nan,
            "travel_per_day": wear.travel_per_day,
            "reversals_per_day": wear.reversals_per_day,
        }
    found |= {
        "automatic": math.nan if window.auto is None else _mean(window.auto),
        "saturated": _saturated(window.op),
        "good": float(np.mean(np.isfinite(window.op) & np.isfinite(window.pv))),
        "pv_std": float(np.std(error[usable])) if usable.any() else math.nan,
    }
    return {name: value if math.isfinite(value) else None for name, value in found.items()}


def _mean(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if known.size else math.nan


def _saturated(op: Floats) -> float:
    """Share of the samples in flat runs at OP's highest or lowest value."""
    known = op[np.isfinite(op)]
    span = float(np.ptp(known)) if known.size else 0.0
    if span == 0.0:
        return math.nan
    near = AT_LIMIT * span
    flat = 0
    for at in (known >= known.max() - near, known <= known.min() + near):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], at.astype(int), [0]])))
        runs = edges[1::2] - edges[::2]
        flat += int(runs[runs >= LEAST_AT_LIMIT].sum())
    return flat / int(known.size)
