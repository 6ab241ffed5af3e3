"""The stiction-unaware offset-free MPC, problem (16) of the paper: what a plant has today.

It knows the linear process only. On a sticky valve its disturbance estimate never settles, and the
loop oscillates; the other controllers of this package are measured against it.

Numerics: the states are eliminated (`CondensedCost`), so the quadratic programme has one unknown a
sample of the horizon. Without active limits its optimum is the linear-quadratic regulator's; that
is tried first, and only when it hits a limit is the QP solved, by PIQP (interior point; measured as
fast as OSQP at this size, and exact to 1e-8 where OSQP stops at its 1e-5).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import piqp
from numpy.typing import NDArray

from compensator.action import (
    Action,
    ActionStatus,
    CompensatorError,
    OpLimits,
    require_finite,
    require_positive,
)
from compensator.conventional.condensed import CondensedCost
from compensator.kernels import multiplied
from compensator.prediction import (
    Disturbance,
    NoiseModel,
    Prediction,
    StateFilter,
    as_designed,
)
from loop_model import ProcessModel

__all__ = ["MpcSettings", "UnawareMpc"]

Array = NDArray[np.float64]

PLANT_MPC_NOISE = NoiseModel(equation=1.0, measurement=1.0, disturbance=30.0)
"""Nearly all of PV's deviation is taken for the disturbance, as MPCs in plants do."""

_NONE = 1e30  # what PIQP takes for an absent bound


@dataclass(frozen=True, slots=True)
class MpcSettings:
    """Settings of `UnawareMpc`.

    Attributes:
        horizon: samples, ``N_H`` of (16a), beyond the dead time.
        pv_weight: Q of (16a) on PV.
        op_weight: R of (16a) on OP's distance from its steady-state target, with OP counted in
            the PV it makes (multiplied by the square of `Prediction.scale`), so that one value
            suits processes of any gain and any units.
        limits: range and rate of OP.
        pv_low, pv_high: soft limits of PV, kept where OP's limits allow it.
        noise: ratios that set the Kalman filter.
        disturbance: where the offset-free disturbance enters.
        max_iterations: bound of the QP solver; past it OP is held.
    """

    horizon: int = 40
    pv_weight: float = 1.0
    op_weight: float = 0.015
    limits: OpLimits = field(default_factory=OpLimits)
    pv_low: float = -math.inf
    pv_high: float = math.inf
    noise: NoiseModel = PLANT_MPC_NOISE
    disturbance: Disturbance = "auto"
    max_iterations: int = 100

    def __post_init__(self) -> None:
        if self.horizon < 2 or self.max_iterations < 1:
            raise CompensatorError(
                f"MpcSettings: horizon must be at least 2 and max_iterations at least 1; got "
                f"{self.horizon} and {self.max_iterations}"
            )
        require_positive("MpcSettings", pv_weight=self.pv_weight, op_weight=self.op_weight)
        if not self.pv_low < self.pv_high:
            raise CompensatorError(
                f"MpcSettings: pv_low must be below pv_high; got {self.pv_low} and {self.pv_high}"
            )


class UnawareMpc:
    """Offset-free linear MPC; see the module's text.

    Args:
        process: the plant's model, the valve taken as healthy.
        settings: weights, horizon, limits, filter.

    Raises:
        CompensatorError: the process cannot be controlled or its disturbance not observed.
    """

    def __init__(self, process: ProcessModel, settings: MpcSettings | None = None) -> None:
        self.settings = settings or MpcSettings()
        self.prediction = Prediction.of(process, self.settings.disturbance)
        self._filter = StateFilter(self.prediction, self.settings.noise)
        self._op = math.nan
        self._pv_bad = False
        self._build()

    def _build(self) -> None:
        s, p = self.settings, self.prediction
        cost = CondensedCost.of(p, s.horizon, s.pv_weight, s.op_weight)
        self.horizon = cost.samples
        self._hessian = cost.hessian + cost.op_weight * np.eye(cost.samples)
        self._linear, self._free, self._forced = cost.linear, cost.free, cost.forced
        regulator = -np.linalg.solve(self._hessian, self._linear)
        self._regulator = as_designed(np.asarray(regulator, dtype=np.float64))
        self._solver: Any = None

    def observe(self, pv: float, op: float) -> None:
        """See `Controller.observe`."""
        require_finite("UnawareMpc.observe", op=op)
        self._pv_bad = not math.isfinite(pv)
        if not self._filter.ready:
            self._op = op
            if not self._pv_bad:
                self._filter.start(pv, op)
            return
        self._filter.advance(op)
        self._filter.correct(pv)
        self._op = op

    def decide(self, sp: float) -> Action:
        """See `Controller.decide`."""
        require_finite("UnawareMpc.decide", sp=sp)
        limits = self.settings.limits
        if not self._filter.ready:
            held = math.nan if math.isnan(self._op) else limits.clip(self._op, self._op)
            return Action(held, ActionStatus.NOT_READY)
        if self._pv_bad:
            return Action(self._op, ActionStatus.PV_BAD)
        free, disturbance = self._filter.free()
        target_state, wanted = self.prediction.equilibrium(sp, disturbance)
        target = min(max(wanted, limits.low), limits.high)
        if target != wanted and not self.prediction.process.is_integrating:
            drive = target + (disturbance if self.prediction.input_disturbance else 0.0)
            target_state, _ = self.prediction.equilibrium(
                self.prediction.process.gain * drive
                + (0.0 if self.prediction.input_disturbance else disturbance),
                disturbance,
            )
        start = free + self.prediction.B * target - target_state
        output = 0.0 if self.prediction.input_disturbance else disturbance
        plan = multiplied(self._regulator, start) + target
        level = float(target_state[0]) + output
        if not self._inside(plan, start, level, target):
            solved = self._solve(start, level, target)
            if solved is None:
                return Action(self._op, ActionStatus.SOLVER_FAILED, target=target)
            plan = solved
        pv_end = level + float(self._free[-1] @ start + self._forced[-1] @ (plan - target))
        status = ActionStatus.OPTIMAL if target == wanted else ActionStatus.LIMITED
        # Clipping removes the solver's last rounding error, nothing else.
        op = limits.clip(float(plan[0]), self._op)
        return Action(op, status, target=target, predicted_pv=pv_end)

    def _pv(self, plan: Array, start: Array, level: float, target: float) -> Array:
        return np.asarray(level + self._free @ start + self._forced @ (plan - target))

    def _inside(self, plan: Array, start: Array, level: float, target: float) -> bool:
        """Whether a plan keeps every limit."""
        s = self.settings
        if plan.min() < s.limits.low or plan.max() > s.limits.high:
            return False
        if math.isfinite(s.limits.rate) and (
            np.abs(np.diff(plan, prepend=self._op)).max() > s.limits.rate
        ):
            return False
        if math.isinf(s.pv_low) and math.isinf(s.pv_high):
            return True
        pv = self._pv(plan, start, level, target)
        return bool(pv.min() >= s.pv_low and pv.max() <= s.pv_high)

    def _solve(self, start: Array, level: float, target: float) -> Array | None:
        """Solve (16) with its limits; None when the solver stops before the optimum.

        Unknowns: OP minus its target for every sample and one slack that PV limits may use. Rows:
        rate of OP, then PV below its upper and above its lower limit.
        """
        s, n = self.settings, self.horizon
        linear = np.append(self._linear @ start, 0.0)
        low = np.append(np.full(n, s.limits.low - target), 0.0)
        high = np.append(np.full(n, s.limits.high - target), _NONE)
        rows, row_low, row_high = [], [], []
        if math.isfinite(s.limits.rate):
            reach = np.full(n, s.limits.rate)
            first = np.zeros(n)
            first[0] = self._op - target
            rows.append(np.hstack([np.eye(n) - np.eye(n, k=-1), np.zeros((n, 1))]))
            row_low.append(first - reach)
            row_high.append(first + reach)
        natural = level + self._free @ start
        for limit, slack, lower in ((s.pv_low, 1.0, True), (s.pv_high, -1.0, False)):
            if math.isfinite(limit):
                rows.append(np.hstack([self._forced, np.full((n, 1), slack)]))
                row_low.append(limit - natural if lower else np.full(n, -_NONE))
                row_high.append(np.full(n, _NONE) if lower else limit - natural)
        bounds = (np.concatenate(row_low), np.concatenate(row_high)) if rows else (None, None)
        if self._solver is None:
            hessian = np.zeros((n + 1, n + 1))
            hessian[:n, :n] = self._hessian
            hessian[n, n] = 1e4 * s.pv_weight
            self._solver = piqp.DenseSolver()
            self._solver.settings.max_iter = s.max_iterations
            matrix = np.vstack(rows) if rows else None
            self._solver.setup(hessian, linear, None, None, matrix, *bounds, low, high)
        else:
            self._solver.update(c=linear, h_l=bounds[0], h_u=bounds[1], x_l=low, x_u=high)
        if self._solver.solve() != piqp.PIQP_SOLVED:
            return None
        return np.asarray(self._solver.result.x, dtype=np.float64)[:n] + target
