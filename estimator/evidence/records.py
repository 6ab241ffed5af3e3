"""What the record itself can tell: samples that were measured, and those that a historian drew."""

from __future__ import annotations

import numpy as np

from estimator.arrays import Array

__all__ = ["drawn_step", "informed_share", "step_left_out"]

_EVEN = 1e-7
"""Second difference, as a share of the span, below which a sample lies on a straight line."""
_MOVES = 1e-9
_FEWEST = 20
_POLLED = 0.8
"""Share of samples that are no straight line between two others from which they were polled: what
was polled bends at nearly every sample."""
_SMALL = 0.1
"""Quantile of the steps between the ends of lines that is the step from which a sample is stored:
noise and the samples stored because time was up make most larger and some smaller."""


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


def step_left_out(op: Array, pv: Array, informed: float) -> float:
    """Step from which a historian stored OP or PV ``(n,)``, as a share of its span.

    0 where samples were polled; ``informed`` is the share of PV's that are no line between others.
    """
    return max(drawn_step(op), drawn_step(pv)) if informed < _POLLED else 0.0


def drawn_step(signal: Array) -> float:
    """Step from which a historian stored a sample of ``signal`` ``(n,)``, as a share of its span.

    Told by how far the ends of the straight lines are apart that it drew; 0 where it drew few.
    """
    known = signal[np.isfinite(signal)]
    span = float(np.ptp(known)) if known.size else 0.0
    if span == 0.0:
        return 0.0
    bends = 1 + np.flatnonzero(np.abs(np.diff(known, 2)) > _EVEN * span)
    ends = np.concatenate([[0], bends, [known.size - 1]])
    steps = np.abs(np.diff(known[ends])) / span
    lines = (np.diff(ends) > 1) & (steps > _MOVES)
    return float(np.quantile(steps[lines], _SMALL)) if int(lines.sum()) > _FEWEST else 0.0
