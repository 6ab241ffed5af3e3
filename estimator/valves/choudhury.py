"""Choudhury's valve: like Kano's, but its band is counted again at every turn of OP."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compiled import kernel
from estimator.valves.base import SlipStickValve, ValveState

__all__ = ["ChoudhuryValve"]


@kernel
def _advance(state: ValveState, op: float, stick_band: float, slip_jump: float) -> ValveState:
    trend = np.sign(op - state.op)
    moving = state.moving
    paused = state.paused
    rest_op = state.rest_op
    if trend == 0.0:
        if moving:
            rest_op = state.op
        return ValveState(state.stem, op, trend, state.direction, False, paused or moving, rest_op)
    if trend != state.trend and not (paused and trend == state.direction):
        rest_op = state.op
        moving = False
        paused = False
    if not moving:
        moving = abs(op - rest_op) > (slip_jump if paused else stick_band)
    if not moving:
        return ValveState(state.stem, op, trend, state.direction, False, paused, rest_op)
    stem = op - trend * 0.5 * (stick_band - slip_jump)
    return ValveState(stem, op, trend, trend, True, False, rest_op)


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
class ChoudhuryValve(SlipStickValve):
    """Choudhury's two-parameter valve.

    It leaves its rest when OP has gone by more than ``S`` since OP last turned, or by more than
    ``J`` when OP merely paused and goes on the same way; it then follows at ``OP - d (S - J) / 2``.
    Each turn of OP starts the count again, so a noisy OP holds this valve longer than Kano's.
    The published flow chart looks at the band one sample after a turn; here the sample of the turn
    itself counts, which is the same for an OP sampled finely.

    Source: Choudhury, Thornhill and Shah (2005), "Modelling valve stiction", Control Engineering
    Practice 13, 641-658.
    """

    def step(self, state: ValveState, op: float) -> ValveState:
        """Advance Choudhury's flow chart by one sample."""
        after: ValveState = _advance(state, float(op), self.stick_band, self.slip_jump)
        return after

    def _run(self, op: NDArray[np.float64], state: ValveState) -> NDArray[np.float64]:
        stem: NDArray[np.float64] = _run(op, state, self.stick_band, self.slip_jump)
        return stem
