"""What the record itself can tell: samples that were measured, and those that a historian drew."""

from __future__ import annotations

import numpy as np

from estimator.arrays import Array

__all__ = ["informed_share"]

_EVEN = 1e-7
"""Second difference, as a share of the span, below which a sample lies on a straight line."""
_MOVES = 1e-9
_FEWEST = 20


def informed_share(signal: Array) -> float:
    """Share of the moving samples of ``signal`` ``(n,)`` that are not on a line between others.

    A historian that compresses keeps the knots of a line and draws the rest of it when asked: what
    lies between two knots is not a measurement. 1 where the signal hardly moves.
    """
    known = signal[np.isfinite(signal)]
    span = float(np.ptp(known)) if known.size else 0.0
    if span == 0.0:
        return 1.0
    moves = np.abs(np.diff(known)) > _MOVES * span
    bends = np.abs(np.diff(known, 2)) > _EVEN * span
    both = moves[1:] & moves[:-1]
    return float(bends[both].mean()) if int(both.sum()) > _FEWEST else 1.0
