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
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from compensator.action import (
    Action,
    ActionStatus,
    require_finite,
)
from compensator.conventional.condensed import CondensedCost
from compensator.hybrid.controller import HybridMpc
from compensator.prediction import Prediction
from compensator.published.embedding_program import EmbeddingProgram, Problem
from compensator.published.embedding_settings import EmbeddingSettings
from compensator.stem_tracking.belief import GAIN
from loop_model import LoopModel, ValveModel

__all__ = ["EmbeddingMpc", "EmbeddingSettings"]

Array = NDArray[np.float64]


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
        estimator = replace(s.estimator.with_limits(s.limits), late=())
        self.compensator = HybridMpc(model, estimator)
        self._cost = CondensedCost.of(self.prediction, s.horizon, s.pv_weight, s.op_weight)
        weight = s.move_weight * self.prediction.scale**2
        self._program = EmbeddingProgram(self._cost, s, weight)
        self._last: Array | None = None
        self._op = math.nan
        self._pv_bad = False

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
    def opposed(self) -> bool:
        """Whether PV answers to OP against the sign of the model's gain."""
        return self.compensator.opposed

    @property
    def iterations(self) -> int:
        """Of IPOPT in the last scan, over all warm starts."""
        return self._program.iterations

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
        self._program.iterations = 0
        starts = self.warm_starts(sp)
        for name, start in starts.items():
            found = self._program.solve(problem, self.model.valve, start)
            if found is None:
                continue
            cost = self._program.price(problem, self.model.valve, found)
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
        detail = (
            f"from {best_name} ({len(starts)} warm starts, {self._program.iterations} iterations)"
        )
        return Action(op, status, problem.target, stem=stem, detail=detail)

    def _problem(self, sp: float) -> tuple[Problem, bool]:
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
        return Problem(belief.stem, self._op, target, linear, gain**2), target != wanted

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
