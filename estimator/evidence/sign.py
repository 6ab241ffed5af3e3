"""The sign of the process gain, found from what the controller does about the error."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.algebra import dot, normal_equations, solve_spd
from estimator.arrays import Array, Mask
from estimator.controller.controller import Controller
from estimator.controller.reading import read_controller
from estimator.settings import Modelling
from estimator.window import carry_on

__all__ = ["controller_action", "gain_sign", "soonest_answer"]

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
_ROUNDING = 1e-5
"""Of OP's moves, as much as rounding leaves: OP is stored to five digits of them or fewer."""
_MOST = 0.5
"""Share of the scans that are most of them."""
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
    return _answer(op, pv, sp).action


def soonest_answer(op: Array, pv: Array, sp: Array | None, sign: float, settings: Modelling) -> int:
    """Least dead time in samples that a process may have: 1, or 0 where OP answers PV later.

    OP that is computed from PV of its own scan tells that PV: a process without dead time would
    explain PV by the controller, run backwards. Signals as for `gain_sign`, whose result ``sign``
    is. Where it is unknown, so is what OP answers: 1 if it moves in most scans, as a controller
    does and a hand does not.
    """
    if sign == 0.0:
        moves = np.diff(op)
        return int(float(np.mean(moves[np.isfinite(moves)] != 0.0)) > _MOST)
    return 1 if sign * _answer(op, pv, sp).now > settings.action_t else 0


@dataclass(frozen=True, slots=True)
class _Answer:
    """What the controller does about the error: t-values, and what they leave over.

    Attributes:
        action: of the sum of the last errors' coefficients.
        now: of the coefficient of the error of the same scan.
        left: share of OP's moves that is left over.
    """

    action: float = 0.0
    now: float = 0.0
    left: float = 1.0


def _answer(op: Array, pv: Array, sp: Array | None) -> _Answer:
    """The answer to the error, with as many of OP's own last moves as it takes."""
    target = None if sp is None else carry_on(sp)
    error = -pv if target is None else target - pv
    usual, predictive = (_regress(op, error, own) for own in (_OWN, _PIPELINE))
    return predictive if predictive.left < min(_NOTHING, _LEAVES * usual.left) else usual


def _regress(op: Array, error: Array, own: int) -> _Answer:
    """The answer to the error with so many of OP's own last moves."""
    moves = np.diff(op, prepend=np.nan)
    first = max(_LAGS - 1, own + 1)
    columns = [error[first - i : op.size - i] for i in range(_LAGS)]
    columns += [moves[first - i : op.size - i] for i in range(1, own + 1)]
    past, now = np.stack(columns, axis=1), moves[first:]
    good = np.isfinite(past).all(axis=1) & np.isfinite(now) & ~_at_limit(op)[first:]
    if int(good.sum()) < max(_LEAST, _ROWS_EACH * len(columns)):
        return _Answer()
    past, now = past[good], now[good]
    ones = np.ones(now.size)
    past = past - np.array([dot(column, ones) for column in past.T.copy()]) / now.size
    now = now - dot(now, ones) / now.size
    rows = np.ascontiguousarray(past.T)
    gram, right = normal_equations(rows, now)
    size = rows.shape[0]
    gram.flat[:: size + 1] *= 1.0 + 1e-9
    found = solve_spd(gram, right)
    left = now - found @ rows
    spread, whole = dot(left, left) / now.size, dot(now, now) / now.size
    sums = np.zeros((2, size))
    sums[0, :_LAGS] = sums[1, 0] = 1.0
    # variances of the sum of the coefficients, and of the first; what rounding leaves is no noise
    noise = max(spread, _ROUNDING**2 * whole)
    variances = [noise * float(solve_spd(gram, one) @ one) for one in sums]
    if not min(variances) > 0.0:
        return _Answer()
    action, at_once = (
        float(found @ one) / math.sqrt(variance)
        for one, variance in zip(sums, variances, strict=True)
    )
    return _Answer(action, at_once, spread / whole)


def _at_limit(op: Array) -> Mask:
    """Scans at which OP stands where it stood, at its highest or lowest value."""
    finite = op[np.isfinite(op)]
    if finite.size == 0:
        return np.zeros(op.size, dtype=bool)
    still = np.diff(op, prepend=np.nan) == 0.0
    found: Mask = still & ((op == finite.max()) | (op == finite.min()))
    return found
