"""The stiction-embedding MPC: problem (16) of the paper with the smoothed valve (5)-(6) inside.

The paper's remedy, and the peer that `HybridMpc` is measured against. Between OP and the process
stands the valve, as one equation a sample:

    min_(u, x)  PV's cost of (16a) for the stem x + R (u - u_s)^2 + R_d (u_i - u_(i-1))^2
    s.t.        x_i = eta1(e_i) x_(i-1) + (1 - eta1(e_i)) u_i + eta2(e_i) fD,   e_i = u_i - x_(i-1)
                OP's range and rate

It is not convex, and where the smoothed valve is flat (the stem sticks) IPOPT sees no way to go:
the result is the best *near its warm start* (the paper says so too, section 4). So it is solved
from three: the plan of the compensator (`HybridMpc`), the last solution moved on by one sample, and
holding. The cheapest of those that converged, priced with the exact valve, is applied; a solve that
stopped at its bound never is.

State, load and stem come from the same estimator as `HybridMpc`'s, so the two differ in the
optimisation alone. Needs CasADi: ``pip install "fieldlink[nlp]"``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensator.action import (
    Action,
    ActionStatus,
    CompensatorError,
    OpLimits,
    require_finite,
    require_not_negative,
    require_positive,
)
from compensator.belief import GAIN
from compensator.condensed import CondensedCost
from compensator.hybrid import HybridMpc, HybridSettings
from compensator.prediction import Prediction
from loop_model import LoopModel, ValveModel

__all__ = ["EmbeddingMpc", "EmbeddingSettings"]

Array = NDArray[np.float64]

_CONVERGED = frozenset({"Solve_Succeeded", "Solved_To_Acceptable_Level"})


@dataclass(frozen=True, slots=True)
class EmbeddingSettings:
    """Settings of `EmbeddingMpc`.

    Attributes:
        horizon: samples beyond the dead time, ``N_H`` of (16a).
        pv_weight: Q of (16a) on PV.
        op_weight: R of (16a), scaled as in `MpcSettings`.
        move_weight: price of the squared change of OP from sample to sample, scaled alike.
        tau: sharpness of (6); from 1e4 on the valve is He's exactly (the paper, section 2.1).
        limits: range and rate of OP.
        max_iterations: bound of IPOPT for each warm start.
        max_seconds: bound of IPOPT for each warm start, seconds of the wall clock.
        estimator: settings of the compensator that estimates and proposes the first warm start
            (its limits are replaced by ``limits``).
    """

    horizon: int = 40
    pv_weight: float = 1.0
    op_weight: float = 0.015
    move_weight: float = 0.0
    tau: float = 1e4
    limits: OpLimits = field(default_factory=OpLimits)
    max_iterations: int = 60
    max_seconds: float = 1.0
    estimator: HybridSettings = field(default_factory=HybridSettings)

    def __post_init__(self) -> None:
        if self.horizon < 2 or self.max_iterations < 1:
            raise CompensatorError(
                f"EmbeddingSettings: horizon must be at least 2 and max_iterations at least 1; got "
                f"{self.horizon} and {self.max_iterations}"
            )
        require_positive(
            "EmbeddingSettings",
            pv_weight=self.pv_weight,
            op_weight=self.op_weight,
            tau=self.tau,
            max_seconds=self.max_seconds,
        )
        require_not_negative("EmbeddingSettings", move_weight=self.move_weight)


@dataclass(frozen=True, eq=False)
class _Problem:
    """What changes from scan to scan: start, target, and of PV's cost the linear term and the
    factor of the quadratic one.
    """

    stem: float
    op: float
    target: float
    linear: Array
    factor: float


def _casadi() -> Any:
    try:
        import casadi
    except ImportError as error:
        raise CompensatorError(
            "the embedding controller needs CasADi with IPOPT, which is not installed; run "
            'pip install "fieldlink[nlp]", or use the hybrid controller, which needs nothing'
        ) from error
    return casadi


class EmbeddingMpc:
    """Stiction-embedding MPC; see the module's text.

    Args:
        model: valve and process.
        settings: weights, horizon, limits, bounds of the solver.

    Raises:
        CompensatorError: CasADi is absent, or the model cannot be controlled.
    """

    def __init__(self, model: LoopModel, settings: EmbeddingSettings | None = None) -> None:
        self.settings = settings or EmbeddingSettings()
        s = self.settings
        self._casadi = _casadi()
        self.compensator = HybridMpc(model, s.estimator.with_limits(s.limits))
        self._cost = CondensedCost.of(self.prediction, s.horizon, s.pv_weight, s.op_weight)
        self._move_weight = s.move_weight * self.prediction.scale**2
        self._solver = self._build()
        self._last: Array | None = None
        self._op = math.nan
        self._pv_bad = False
        self.iterations = 0

    @property
    def model(self) -> LoopModel:
        """The model in use."""
        return self.compensator.model

    @property
    def prediction(self) -> Prediction:
        """The process, its disturbance at the input."""
        return self.compensator.prediction

    @property
    def ready(self) -> bool:
        """Whether a PV was ever seen."""
        return self.compensator.ready

    @property
    def horizon(self) -> int:
        """Samples that are planned, dead time included."""
        return self._cost.samples

    @property
    def held_variance(self) -> float:
        """Variance of PV that the noise seen so far makes with the stem held (PV squared)."""
        return self.compensator.held_variance

    @property
    def load_stepped(self) -> bool:
        """Whether the last PV showed a step of the load."""
        return self.compensator.load_stepped

    @property
    def solution(self) -> Array | None:
        """OP over the horizon as solved last, shape ``(horizon,)``; None without one."""
        return None if self._last is None else self._last.copy()

    @property
    def is_moving(self) -> bool:
        """Whether the last OP moved the stem, or the last solution is about to."""
        if self._last is None:
            return self.compensator.is_moving
        stem = self.compensator.stem
        soon = self.model.valve.simulate(self._last[:5], stem)
        return self.compensator.stem_moved or bool(np.any(soon != stem))

    def improve_on(self, deviation: float, travel: float) -> None:
        """See `HybridMpc.improve_on`."""
        self.compensator.improve_on(deviation, travel)

    def change_valve(self, valve: ValveModel) -> None:
        """Go on with other valve parameters; stem, state and disturbance are kept."""
        self.compensator.change_valve(valve)

    def require_reachable(self, valve: ValveModel) -> tuple[float, float]:
        """See `HybridMpc.require_reachable`."""
        return self.compensator.require_reachable(valve)

    def observe(self, pv: float, op: float) -> None:
        """See `Controller.observe`."""
        self.compensator.observe(pv, op)
        if self._last is not None and abs(op - self._last[0]) > 1e-9:
            self._last = None  # somebody else moved OP: the last plan is void
        self._op = op
        self._pv_bad = not math.isfinite(pv)

    def decide(self, sp: float) -> Action:
        """See `Controller.decide`."""
        require_finite("EmbeddingMpc.decide", sp=sp)
        tracker = self.compensator.tracker
        if not tracker.ready:
            return Action(self._op, ActionStatus.NOT_READY)
        if self._pv_bad:
            return Action(self._op, ActionStatus.PV_BAD)
        problem, limited = self._problem(sp)
        best: Array | None = None
        best_cost = math.inf
        best_name = ""
        self.iterations = 0
        starts = self.warm_starts(sp)
        for name, start in starts.items():
            found = self._solve(problem, start)
            if found is None:
                continue
            cost = self._price(problem, found)
            if cost < best_cost:
                best, best_cost, best_name = found, cost, name
        if best is None:
            self._last = None
            hold = self.settings.limits.clip(problem.stem, self._op)
            return Action(hold, ActionStatus.SOLVER_FAILED, problem.target, stem=problem.stem)
        self._last = best
        op = self.settings.limits.clip(float(best[0]), self._op)
        self._last[0] = op
        stem = self.model.valve.step(problem.stem, op)
        status = ActionStatus.LIMITED if limited else ActionStatus.OPTIMAL
        detail = f"from {best_name} ({len(starts)} warm starts, {self.iterations} iterations)"
        return Action(op, status, problem.target, stem=stem, detail=detail)

    def _problem(self, sp: float) -> tuple[_Problem, bool]:
        tracker = self.compensator.tracker
        belief, p = tracker.best, self.prediction
        # The stem moves the process's drive by a gain known a little better than the model's.
        gain, drive = 1.0 + float(belief.errors[GAIN]), tracker.drive(belief)
        target_state, wanted_drive = p.equilibrium(sp, 0.0)
        wanted = belief.stem + (wanted_drive - drive) / gain
        low, high = self.compensator.reach
        target = min(max(wanted, low), high)
        reached = drive + gain * (target - belief.stem)
        if target != wanted and not p.process.is_integrating:
            target_state, _ = p.equilibrium(p.process.gain * reached, 0.0)
        distance = tracker.free(belief) + p.B * reached - target_state
        linear = gain * (self._cost.linear @ distance)
        return _Problem(belief.stem, self._op, target, linear, gain**2), target != wanted

    def warm_starts(self, sp: float) -> dict[str, Array]:
        """Return OP over the horizon by name: the compensator's plan, the last solution moved on,
        and holding; those that are the same only once.
        """
        plan = self.compensator.plan_op(sp, self.horizon)
        hold = self._ramp_to(self.compensator.stem)
        starts = {"the compensator's plan": plan}
        if self._last is not None:
            starts["the shifted solution"] = np.append(self._last[1:], self._last[-1])
        if not np.allclose(plan, hold):
            starts["hold"] = hold
        return starts

    def _ramp_to(self, op: float) -> Array:
        path = np.empty(self.horizon)
        before = self._op
        for i in range(self.horizon):
            path[i] = before = self.settings.limits.clip(op, before)
        return path

    def _price(self, problem: _Problem, op: Array) -> float:
        """Return the cost of an OP trajectory with the exact valve, but for the part that is the
        same for all trajectories.
        """
        stem = self.model.valve.simulate(op, problem.stem)
        z = stem - problem.target
        moves = np.diff(op, prepend=problem.op)
        return float(
            problem.factor * (z @ self._cost.hessian @ z)
            + 2.0 * z @ problem.linear
            + self._cost.op_weight * np.sum((op - problem.target) ** 2)
            + self._move_weight * np.sum(moves**2)
        )

    def _build(self) -> Any:
        """Set up IPOPT once; start, target and linear term are parameters."""
        ca, s, n = self._casadi, self.settings, self.horizon
        u, x = ca.SX.sym("u", n), ca.SX.sym("x", n)
        stem0, op0, target = ca.SX.sym("stem0"), ca.SX.sym("op0"), ca.SX.sym("target")
        linear, factor = ca.SX.sym("linear", n), ca.SX.sym("factor")
        z = x - target
        before, previous = ca.vertcat(stem0, x[:-1]), ca.vertcat(op0, u[:-1])
        cost = factor * ca.bilin(ca.SX(ca.DM(self._cost.hessian)), z, z) + 2.0 * ca.dot(linear, z)
        cost += self._cost.op_weight * ca.sumsqr(u - target)
        cost += self._move_weight * ca.sumsqr(u - previous)
        frictions = ca.SX.sym("frictions", 2)
        rows = [x - _smoothed(ca, frictions, s.tau, before, u)]
        rated = math.isfinite(s.limits.rate)
        if rated:
            rows.append(u - previous)
        self._row_low = np.zeros(n * len(rows))
        self._row_high = np.zeros(n * len(rows))
        if rated:
            self._row_low[n:], self._row_high[n:] = -s.limits.rate, s.limits.rate
        # A small first barrier keeps IPOPT at its warm start, which is what it is given for.
        options = {
            "print_time": False,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.max_iter": s.max_iterations,
            "ipopt.max_wall_time": s.max_seconds,
            "ipopt.warm_start_init_point": "yes",
            "ipopt.mu_init": 1e-4,
            "ipopt.tol": 1e-6,
        }
        problem = {
            "x": ca.vertcat(u, x),
            "p": ca.vertcat(stem0, op0, target, factor, frictions, linear),
            "f": cost,
            "g": ca.vertcat(*rows),
        }
        return ca.nlpsol("embedding", "ipopt", problem, options)

    def _solve(self, problem: _Problem, start: Array) -> Array | None:
        """Solve from one warm start; None unless IPOPT says that it converged."""
        limits, n = self.settings.limits, self.horizon
        valve = self.model.valve
        stem = valve.simulate(start, problem.stem)
        known = [problem.stem, problem.op, problem.target, problem.factor]
        frictions = [valve.static_friction, valve.dynamic_friction]
        low = np.concatenate([np.full(n, limits.low), np.full(n, -np.inf)])
        high = np.concatenate([np.full(n, limits.high), np.full(n, np.inf)])
        result = self._solver(
            x0=np.concatenate([start, stem]),
            p=np.concatenate([known, frictions, problem.linear]),
            lbx=low,
            ubx=high,
            lbg=self._row_low,
            ubg=self._row_high,
        )
        stats = self._solver.stats()
        self.iterations += int(stats["iter_count"])
        if stats["return_status"] not in _CONVERGED:
            return None
        return np.array(result["x"], dtype=np.float64).ravel()[:n]


def _smoothed(casadi: Any, frictions: Any, tau: float, stem: Any, op: Any) -> Any:
    """Return (5) with (6), as CasADi expressions of the stem before and of OP."""
    fs, fd = frictions[0], frictions[1]
    error = op - stem
    above, below = casadi.tanh(tau * (error + fs)), casadi.tanh(tau * (fs - error))
    eta1, eta2 = 0.5 * (above + below), 0.5 * (below - above)
    return eta1 * stem + (1.0 - eta1) * op + eta2 * fd
