"""Cycles of an oscillating signal, which several published methods take as known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["average_blocks", "crossings", "process_sign"]

Array = NDArray[np.float64]


def crossings(curve: Array) -> list[int]:
    """Samples after which the curve changes sign, noise within 20 % of its deviation ignored."""
    band = 0.2 * float(curve.std())
    sides = np.where(curve > band, 1, np.where(curve < -band, -1, 0))
    found, side, last = [], 0, 0
    for k, now in enumerate(sides):
        if now == 0:
            continue
        if side and now != side:
            between = curve[last : k + 1]
            flips = np.flatnonzero(np.sign(between[:-1]) != np.sign(between[1:]))
            found.append(last + int(flips[0]) + 1 if flips.size else k)
        side, last = int(now), k
    return found


def average_blocks(signal: Array, size: int) -> Array:
    """Means of ``size`` samples each; what is left over at the end is dropped."""
    whole = signal.size // size * size
    return np.asarray(signal[:whole].reshape(-1, size).mean(axis=1))


def process_sign(op: Array, pv: Array) -> float:
    """Sign of the process, from the controller's action: OP rises where PV is low."""
    return -1.0 if float(np.dot(np.diff(op), pv[1:] - pv.mean())) > 0.0 else 1.0
