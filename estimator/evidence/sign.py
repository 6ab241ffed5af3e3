"""The sign of the process gain, found from what the controller does about the error."""

from __future__ import annotations

import math

import numpy as np

from estimator.algebra import dot, normal_equations, solve_spd
from estimator.arrays import Array, Mask
from estimator.controller.controller import Controller
from estimator.controller.reading import read_controller
from estimator.settings import Modelling
from estimator.window import carry_on

__all__ = ["controller_action", "gain_sign"]

_LAGS = 4
"""Errors that a move is explained by: three make a PID controller, one more a slow scan."""
_OWN = 2
"""OP's own last moves: the filter of a derivative."""
_PIPELINE = 20
"""OP's own last moves that a predictive controller (an MPC, a Smith predictor) counts on: those of
which PV shows nothing yet, up to the longest dead time that is usual, in scans."""
_NOTHING, _LEAVES = 0.01, 0.1
"""Largest share of OP's moves that the controller's law leaves over (OP is computed: only its
rounding), and that it leaves of what two own moves leave."""
_LEAST, _ROWS_EACH = 50, 8
"""Moves, in all and for each regressor, below which the sign is unknown."""

_EXPLAINED = 0.7
"""Share of OP's moves that sums over several samples must explain where nothing else tells the
sign: of OP that no controller moves they explain less (tuning family: 0.70 and more for all loops
that need it; random walks and steps of OP: below for 75 of 80)."""


def gain_sign(
    op: Array, pv: Array, sp: Array | None, exact: Controller | None, settings: Modelling
) -> float:
    """Sign of the process gain, 1 or -1, as feedback needs it; 0 where it is unknown.

    Args:
        op, pv, sp: ``(n,)`` each, NaN where bad.
        exact: the controller where it explains OP to rounding (`read_aligned`): it tells the sign.
            Else the action on the last errors does, and where that is lost in noise sums over many
            samples.
        settings: see `estimator.settings`.
    """
    if exact is not None:
        return _sign_of(exact)
    action = controller_action(op, pv, sp)
    if abs(action) > settings.action_t:
        return math.copysign(1.0, action)
    found = read_controller(op, pv, sp)
    return 0.0 if found is None or found.explained < _EXPLAINED else _sign_of(found)


def _sign_of(found: Controller) -> float:
    return 1.0 if found.action == "reverse" else -1.0


def controller_action(op: Array, pv: Array, sp: Array | None) -> float:
    """t-value of the controller's action on the error, ``(n,)`` each, NaN where bad.

    OP's moves are regressed on the last four errors and on its own last two moves; the sum of the
    errors' coefficients over its standard deviation. A predictive controller answers to moves that
    PV does not show yet: its law needs twenty, and where these leave nothing of OP's moves while
    two leave some, twenty are taken. Positive where OP rises when PV is too low, as it must be with
    a process of positive gain. 0 where it is unknown. Scans at one of OP's limits tell nothing and
    are left out.
    """
    target = None if sp is None else carry_on(sp)
    error = -pv if target is None else target - pv
    action, left = _regress(op, error, _OWN)
    predictive, rest = _regress(op, error, _PIPELINE)
    return predictive if rest < min(_NOTHING, _LEAVES * left) else action


def _regress(op: Array, error: Array, own: int) -> tuple[float, float]:
    """t-value of the action, and the share of OP's moves that is left over, with so many of OP's
    own last moves.
    """
    moves = np.diff(op, prepend=np.nan)
    first = max(_LAGS - 1, own + 1)
    columns = [error[first - i : op.size - i] for i in range(_LAGS)]
    columns += [moves[first - i : op.size - i] for i in range(1, own + 1)]
    past, now = np.stack(columns, axis=1), moves[first:]
    good = np.isfinite(past).all(axis=1) & np.isfinite(now) & ~_at_limit(op)[first:]
    if int(good.sum()) < max(_LEAST, _ROWS_EACH * len(columns)):
        return 0.0, 1.0
    past, now = past[good], now[good]
    ones = np.ones(now.size)
    past = past - np.array([dot(column, ones) for column in past.T.copy()]) / now.size
    now = now - dot(now, ones) / now.size
    rows = np.ascontiguousarray(past.T)
    gram, right = normal_equations(rows, now)
    size = rows.shape[0]
    gram.flat[:: size + 1] *= 1.0 + 1e-9
    of_errors = np.zeros(size)
    of_errors[:_LAGS] = 1.0
    found = solve_spd(gram, right)
    left = now - found @ rows
    spread, whole = dot(left, left) / now.size, dot(now, now) / now.size
    # variance of the sum of the coefficients
    variance = spread * float(solve_spd(gram, of_errors) @ of_errors)
    if not variance > 0.0:
        return 0.0, 1.0
    return float(found @ of_errors) / math.sqrt(variance), spread / whole


def _at_limit(op: Array) -> Mask:
    """Scans at which OP stands where it stood, at its highest or lowest value."""
    finite = op[np.isfinite(op)]
    if finite.size == 0:
        return np.zeros(op.size, dtype=bool)
    still = np.diff(op, prepend=np.nan) == 0.0
    found: Mask = still & ((op == finite.max()) | (op == finite.min()))
    return found
