"""Kano's valve: it follows OP until OP turns or stops, and forgets nothing while it rests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compiled import kernel
from estimator.valves.base import SlipStickValve, ValveState

__all__ = ["KanoValve"]


@kernel
def _advance(state: ValveState, op: float, stick_band: float, slip_jump: float) -> ValveState:
    trend = np.sign(op - state.op)
    moving = state.moving
    direction = state.direction
    rest_op = state.rest_op
    if moving and trend * state.trend <= 0.0:
        moving = False
        rest_op = state.op
    if not moving:
        beyond = direction * (op - rest_op)
        if -beyond > stick_band:
            direction = -direction
            moving = True
        elif beyond > slip_jump:
            moving = True
    stem = op - direction * 0.5 * (stick_band - slip_jump) if moving else state.stem
    return ValveState(stem, op, trend, direction, moving, False, rest_op)


@kernel
def _run(
    op: NDArray[np.float64], state: ValveState, stick_band: float, slip_jump: float
) -> NDArray[np.float64]:
    out = np.empty_like(op)
    for k in range(op.size):
        state = _advance(state, op[k], stick_band, slip_jump)
        out[k] = state.stem
    return out


@dataclass(frozen=True, slots=True)
class KanoValve(SlipStickValve):
    """Kano's two-parameter valve.

    While it moves, ``stem = OP - d (S - J) / 2`` with ``d`` the direction of travel. It comes to
    rest when OP turns or stops, and leaves when OP has gone on by more than ``J`` or back by more
    than ``S``, counted from the OP at which it came to rest.

    Source: Kano, Maruta, Kugemoto and Shimizu (2004), "Practical model and detection algorithm for
    valve stiction", IFAC DYCOPS, 859-864.
    """

    def step(self, state: ValveState, op: float) -> ValveState:
        """Advance Kano's flow chart by one sample."""
        after: ValveState = _advance(state, float(op), self.stick_band, self.slip_jump)
        return after

    def _run(self, op: NDArray[np.float64], state: ValveState) -> NDArray[np.float64]:
        stem: NDArray[np.float64] = _run(op, state, self.stick_band, self.slip_jump)
        return stem
