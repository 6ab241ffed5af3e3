"""The sign of the process gain, told by what the controller does about the error."""

from __future__ import annotations

import math

import numpy as np

from estimator.lanes import Array, dot, solve_spd

__all__ = ["controller_action"]

_LAGS = 4
_LEAST = 50


def controller_action(op: Array, pv: Array, sp: Array | None) -> float:
    """t-value of the controller's action on the error, ``(n,)`` each, NaN where bad.

    OP's moves are regressed on the last four errors; the sum of the coefficients over its standard
    deviation. Positive where OP rises when PV is too low, as it must be with a process of positive
    gain. 0 where it cannot be told.
    """
    known = sp is not None and bool(np.isfinite(sp).all())
    error = (sp - pv) if sp is not None and known else -pv
    n = op.size
    moves = np.diff(op)[_LAGS - 2 :]
    past = np.stack([error[_LAGS - 1 - i : n - i] for i in range(_LAGS)], axis=1)
    past = past[: moves.size]
    good = np.isfinite(past).all(axis=1) & np.isfinite(moves)
    if int(good.sum()) < _LEAST:
        return 0.0
    past, moves = past[good], moves[good]
    ones = np.ones(moves.size)
    past = past - np.array([dot(column, ones) for column in past.T.copy()]) / moves.size
    moves = moves - dot(moves, ones) / moves.size
    rows = np.ascontiguousarray(past.T)
    gram = np.array([[dot(a, b) for b in rows] for a in rows])
    gram.flat[:: _LAGS + 1] *= 1.0 + 1e-9
    right = np.array([dot(a, moves) for a in rows])
    found = solve_spd(gram, right)
    left = moves - found @ rows
    spread = dot(left, left) / moves.size
    # variance of the sum of the coefficients
    variance = spread * float(solve_spd(gram, np.ones(_LAGS)).sum())
    if not variance > 0.0:
        return 0.0
    return float(found.sum()) / math.sqrt(variance)
