"""He's curve fitting: does OP swing in triangles (the valve) or in sines (tuning, outside)?

Source: He, Wang, Pottmann and Qin (2007), "A curve fitting method for detecting valve stiction in
oscillating control loops", Industrial and Engineering Chemistry Research 46, 4549-4560. For a
self-regulating process the curve is OP; for an integrating one the paper takes PV.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend

from benchmarks.published.cycles import crossings
from benchmarks.published.finding import Finding

__all__ = ["fit_curve"]

Array = NDArray[np.float64]

STICKY, HEALTHY = 0.6, 0.4
"""Stiction index above which, and below which, the paper decides."""
SHORTEST = 6
"""Samples of a half cycle that can be fitted: a triangle has three unknowns."""


def _sine_error(piece: Array) -> float:
    shape = np.sin(np.pi * (np.arange(piece.size) + 0.5) / piece.size)
    amplitude = float(shape @ piece) / float(shape @ shape)
    return float(((piece - amplitude * shape) ** 2).sum())


def _triangle_error(piece: Array) -> float:
    """Return the least error of two lines from both ends that meet at one sample between them."""
    n = piece.size
    time = np.arange(n) + 0.5
    best = np.inf
    for peak in range(1, n):
        shape = np.where(time < peak, time / peak, (n - time) / (n - peak))
        height = float(shape @ piece) / float(shape @ shape)
        best = min(best, float(((piece - height * shape) ** 2).sum()))
    return best


def fit_curve(op: Array, pv: Array, *, integrating: bool = False) -> Finding:
    """He's stiction index as score: squared error of sines over that of sines and triangles."""
    curve = detrend(np.asarray(pv if integrating else op, dtype=np.float64))
    ends = crossings(curve)
    pieces = [curve[a:b] for a, b in pairwise(ends) if b - a >= SHORTEST]
    if len(pieces) < 2:
        return Finding("undecided", 0.5)
    sine = sum(_sine_error(piece) for piece in pieces)
    triangle = sum(_triangle_error(piece) for piece in pieces)
    if sine + triangle <= 0.0:
        return Finding("undecided", 0.5)
    index = sine / (sine + triangle)
    if index > STICKY:
        return Finding("stiction", index)
    return Finding("no_stiction" if index < HEALTHY else "undecided", index)
