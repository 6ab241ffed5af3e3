"""What a method could tell at best: one that is shown the true stem.

PV is predicted from its own past and from the stem, and from its own past and OP. The record can
show a sticky valve only where the stem predicts PV better; how much better is a log-likelihood
ratio between two regressions of the same size. OP and stem of the same scan are left out: the
controller computes OP from the PV of that scan, so OP would give it away.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["log_ratio"]

Array = NDArray[np.float64]

ORDERS = (2, 5, 14)
"""Samples of PV's own past: a low order for clean records, a high one for white noise on PV."""
LONGEST_REACH = 40
"""Past samples of OP or stem at most, whatever the dead time."""


def _squares(pv: Array, cause: Array, order: int, reach: int) -> tuple[float, int]:
    deepest = max(order, reach)
    rows = np.arange(deepest, pv.size)
    past = [pv[rows - i] for i in range(1, order + 1)]
    past += [cause[rows - i] for i in range(1, reach + 1)]
    design = np.column_stack([*past, np.ones(rows.size)])
    good = np.isfinite(design).all(axis=1) & np.isfinite(pv[rows])
    design, target = design[good], pv[rows][good]
    if target.size < 2 * design.shape[1]:
        return np.nan, 0
    scale = np.maximum(design.std(axis=0), 1e-12)
    scale[-1] = 1.0
    design = design / scale
    gram = design.T @ design
    gram += 1e-10 * np.trace(gram) / len(gram) * np.eye(len(gram))
    residual = target - design @ np.linalg.solve(gram, design.T @ target)
    return float(residual @ residual), target.size


def log_ratio(op: Array, pv: Array, stem: Array, dead_time: float) -> float:
    """Log-likelihood of PV with the true stem less that with OP; shape ``(n,)`` each.

    ``dead_time`` is in samples. The best of several orders counts; 0 where a record is too short.
    """
    reach = min(int(np.ceil(dead_time)) + 4, LONGEST_REACH)
    middle, spread = np.nanmean(pv), max(float(np.nanstd(pv)), 1e-12)
    pv, stem, op = (pv - middle) / spread, stem - np.nanmean(stem), op - np.nanmean(op)
    best = 0.0
    for order in ORDERS:
        with_stem, n = _squares(pv, stem, order, reach)
        with_op, _ = _squares(pv, op, order, reach)
        if n:
            best = max(best, 0.5 * n * float(np.log(max(with_op, 1e-12) / max(with_stem, 1e-12))))
    return best
