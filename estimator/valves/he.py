"""He's valve, its smooth form, and He and Wang's valve with inertia: memory is the stem alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compiled import kernel
from estimator.valves.base import SlipStickValve, ValveState

__all__ = ["HeValve", "SemiPhysicalValve", "SmoothedValve"]


@kernel
def _slip(stem: float, op: float, static: float, dynamic: float, overshoot: float) -> float:
    error = op - stem
    if error > static:
        return stem + overshoot * (error - dynamic)
    if error < -static:
        return stem + overshoot * (error + dynamic)
    return stem


@kernel
def _run_slip(
    op: NDArray[np.float64], stem: float, static: float, dynamic: float, overshoot: float
) -> NDArray[np.float64]:
    out = np.empty_like(op)
    for k in range(op.size):
        stem = _slip(stem, op[k], static, dynamic, overshoot)
        out[k] = stem
    return out


@kernel
def _blend(stem: float, op: float, static: float, dynamic: float, tau: float) -> float:
    error = op - stem
    upper = math.tanh(tau * (static - error))
    lower = math.tanh(tau * (static + error))
    stay = 0.5 * (lower + upper)
    shift = 0.5 * (upper - lower)
    return stay * stem + (1.0 - stay) * op + shift * dynamic


@kernel
def _run_blend(
    op: NDArray[np.float64], stem: float, static: float, dynamic: float, tau: float
) -> NDArray[np.float64]:
    out = np.empty_like(op)
    for k in range(op.size):
        stem = _blend(stem, op[k], static, dynamic, tau)
        out[k] = stem
    return out


@dataclass(frozen=True, slots=True)
class HeValve(SlipStickValve):
    """He's two-parameter valve, equations (3)-(4) of Bacci di Capaci et al. (2018).

    Source: He, Wang, Pottmann and Qin (2007), "A curve fitting method for detecting valve stiction
    in oscillating control loops", Ind. Eng. Chem. Res. 46, 4549-4560.
    """

    def step(self, state: ValveState, op: float) -> ValveState:
        """Equation (4): slip to ``op -+ fD`` where ``|op - stem| > fS``, else stay."""
        stem = _slip(state.stem, op, self.static_friction, self.dynamic_friction, 1.0)
        return state._replace(stem=stem, op=op)

    def _run(self, op: NDArray[np.float64], state: ValveState) -> NDArray[np.float64]:
        stem: NDArray[np.float64] = _run_slip(
            op, state.stem, self.static_friction, self.dynamic_friction, 1.0
        )
        return stem


@dataclass(frozen=True, slots=True)
class SmoothedValve(SlipStickValve):
    """The smoothed valve, equations (5)-(6) of Bacci di Capaci et al. (2018).

    ``tau`` is the sharpness, per unit of OP: the switch from stick to slip is ``2 / tau`` wide.
    """

    tau: float = 1e4

    def __post_init__(self) -> None:
        # Not super(): a dataclass with slots is a new class, which a bare super() does not know.
        SlipStickValve.__post_init__(self)
        if not (math.isfinite(self.tau) and self.tau > 0.0):
            raise ValueError(
                f"tau must be positive and finite (the paper: 250 to 1e4); got {self.tau!r}"
            )

    def step(self, state: ValveState, op: float) -> ValveState:
        """Equation (5) with the two blending functions of (6)."""
        stem = _blend(state.stem, op, self.static_friction, self.dynamic_friction, self.tau)
        return state._replace(stem=stem, op=op)

    def _run(self, op: NDArray[np.float64], state: ValveState) -> NDArray[np.float64]:
        stem: NDArray[np.float64] = _run_blend(
            op, state.stem, self.static_friction, self.dynamic_friction, self.tau
        )
        return stem


@dataclass(frozen=True, slots=True)
class SemiPhysicalValve(SlipStickValve):
    """He and Wang's three-parameter semi-physical valve: a slip carries the stem past its balance.

    ``overshoot`` is their ``K``: 1 is He's valve; an undamped stem travels twice as far as the
    force balance asks, and they recommend 1.99 for the usual valve.

    Source: He and Wang (2010), "Valve stiction modeling: first-principles vs data-drive
    approaches", American Control Conference, 3777-3782; (2014), Ind. Eng. Chem. Res. 53,
    12010-12022.
    """

    overshoot: float = 1.99

    def __post_init__(self) -> None:
        SlipStickValve.__post_init__(self)
        if not 1.0 <= self.overshoot <= 2.0:
            raise ValueError(
                f"overshoot must lie in 1 (no inertia) to 2 (no damping); got {self.overshoot!r}"
            )

    def step(self, state: ValveState, op: float) -> ValveState:
        """Slip by ``K (|op - stem| - fD)`` where ``|op - stem| > fS``, else stay."""
        stem = _slip(state.stem, op, self.static_friction, self.dynamic_friction, self.overshoot)
        return state._replace(stem=stem, op=op)

    def _run(self, op: NDArray[np.float64], state: ValveState) -> NDArray[np.float64]:
        stem: NDArray[np.float64] = _run_slip(
            op, state.stem, self.static_friction, self.dynamic_friction, self.overshoot
        )
        return stem
