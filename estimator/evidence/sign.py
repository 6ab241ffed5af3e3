"""The sign of the process gain, found from what the controller does about the error."""

from __future__ import annotations

import math

import numpy as np

from estimator.algebra import dot, solve_spd
from estimator.arrays import Array, Mask
from estimator.window import carry_on

__all__ = ["controller_action"]

_LAGS = 4
"""Errors that a move is explained by: three make a PID controller, one more a slow scan."""
_OWN = 2
"""OP's own last moves: the filter of a derivative."""
_LEAST = 50
"""Moves below which the sign is unknown."""


def controller_action(op: Array, pv: Array, sp: Array | None) -> float:
    """t-value of the controller's action on the error, ``(n,)`` each, NaN where bad.

    OP's moves are regressed on the last four errors and on its own last two moves; the sum of the
    errors' coefficients over its standard deviation. Positive where OP rises when PV is too low, as
    it must be with a process of positive gain. 0 where it is unknown. Scans at one of OP's
    limits tell nothing and are left out.
    """
    target = None if sp is None else carry_on(sp)
    error = -pv if target is None else target - pv
    moves = np.diff(op, prepend=np.nan)
    first = max(_LAGS - 1, _OWN + 1)
    columns = [error[first - i : op.size - i] for i in range(_LAGS)]
    columns += [moves[first - i : op.size - i] for i in range(1, _OWN + 1)]
    past, now = np.stack(columns, axis=1), moves[first:]
    good = np.isfinite(past).all(axis=1) & np.isfinite(now) & ~_at_limit(op)[first:]
    if int(good.sum()) < _LEAST:
        return 0.0
    past, now = past[good], now[good]
    ones = np.ones(now.size)
    past = past - np.array([dot(column, ones) for column in past.T.copy()]) / now.size
    now = now - dot(now, ones) / now.size
    rows = np.ascontiguousarray(past.T)
    gram = np.array([[dot(a, b) for b in rows] for a in rows])
    size = rows.shape[0]
    gram.flat[:: size + 1] *= 1.0 + 1e-9
    right = np.array([dot(a, now) for a in rows])
    of_errors = np.zeros(size)
    of_errors[:_LAGS] = 1.0
    found = solve_spd(gram, right)
    left = now - found @ rows
    spread = dot(left, left) / now.size
    # variance of the sum of the coefficients
    variance = spread * float(solve_spd(gram, of_errors) @ of_errors)
    if not variance > 0.0:
        return 0.0
    return float(found @ of_errors) / math.sqrt(variance)


def _at_limit(op: Array) -> Mask:
    """Scans at which OP stands where it stood, at its highest or lowest value."""
    finite = op[np.isfinite(op)]
    if finite.size == 0:
        return np.zeros(op.size, dtype=bool)
    still = np.diff(op, prepend=np.nan) == 0.0
    found: Mask = still & ((op == finite.max()) | (op == finite.min()))
    return found
