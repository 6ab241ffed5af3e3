"""Who has the loop: the plant's own controller, or the compensator while its model is good.

Both controllers observe every scan, so either can take over at any scan, and on the scan of a
change OP stays where it is. A model is offered (from a parameter block) and withdrawn; the
supervisor decides when to switch. Rules:

* never while the valve is being moved;
* the first model is taken as it is, later ones change fS and fD at a limited rate; a changed
  process means a new compensator, which first relives the recent history;
* the compensated loop is compared with itself before; when it is worse, grows or hunts, the base
  controller gets the loop back and that model is not tried again;
* PV bad or frozen for long, a solver that keeps passing its bound, expiry, a dead heartbeat or an
  operator do the same; the reason stays visible.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

from compensator.action import (
    Action,
    ActionStatus,
    CompensatorError,
    Controller,
    require_finite,
    require_positive,
)
from compensator.hybrid import HybridMpc, HybridSettings
from compensator.prediction import Prediction
from compensator.screen import PvScreen
from compensator.watch import LoopFigures, LoopWatch, WatchVerdict, oscillation_period
from loop_model import LoopModel, ValveModel

__all__ = ["Supervisor", "SupervisorSettings", "SupervisorState", "WithdrawReason"]


class SupervisorState(Enum):
    """Who has the loop."""

    BASE = "the base controller has the loop, no valve model is offered"
    WAITING = "a model is accepted; the compensator takes over when the valve rests"
    COMPENSATING = "the compensator has the loop"
    MANUAL = "an operator has the loop; both controllers follow"


class WithdrawReason(Enum):
    """Why the compensator does not have the loop; the value is the advice."""

    NONE = "no reason: nothing was withdrawn"
    EXPIRED = "the block's time of validity is over; see why no newer one was written"
    HEARTBEAT_DEAD = "the daemon's heartbeat stands still; check the daemon and the network"
    OPERATOR = "withdrawn by an operator, or the enable bit is off"
    NO_STICTION = "the valve was found healthy; the base controller suffices"
    PV_BAD = "PV was bad for too long; the compensator returns when PV does"
    PV_FROZEN = "PV repeats one value: its sensor is frozen; the compensator returns with PV"
    SOLVER = "the compensator's solver passed its bound several scans in a row; use another one"
    WORSE = "PV deviated more than before; the model was given up, identify again"
    GROWING = "the oscillation grew; the model was given up, identify again"
    HUNTING = "OP travelled more than before for no gain; the model was given up, identify again"
    REFUSED = "the offered model cannot be used; see `refusal`"


_GIVEN_UP = {
    WatchVerdict.WORSE: WithdrawReason.WORSE,
    WatchVerdict.GROWING: WithdrawReason.GROWING,
    WatchVerdict.HUNTING: WithdrawReason.HUNTING,
}


_PASSING = (WithdrawReason.PV_BAD, WithdrawReason.PV_FROZEN, WithdrawReason.SOLVER)
_PAUSES = 3
"""Pauses that an overtaxed solver is given before it is given up."""


@dataclass(frozen=True, slots=True)
class SupervisorSettings:
    """Settings of `Supervisor`.

    Attributes:
        hybrid: settings of the compensator.
        friction_rate: largest change of fS and of fD per scan when a newer model differs, in OP.
        history: scans that a new compensator relives, to find stem and load at once; four times as
            many tell how good the loop was before.
        pv_bad_limit: scans of bad PV after which the base controller gets the loop.
        pv_frozen_limit: least scans in which PV repeats one value to count as frozen (`PvScreen`).
        solver_limit: scans in a row that the compensator's solver may pass its bound; then the base
            controller has the loop for a horizon, and for good from the fourth time on.
        worse_by: factor of PV's mean square error, against before, that is too much.
    """

    hybrid: HybridSettings = field(default_factory=HybridSettings)
    friction_rate: float = 0.05
    history: int = 300
    pv_bad_limit: int = 10
    pv_frozen_limit: int = 30
    solver_limit: int = 3
    worse_by: float = 1.05

    def __post_init__(self) -> None:
        require_positive(
            "SupervisorSettings",
            friction_rate=self.friction_rate,
            history=self.history,
            pv_bad_limit=self.pv_bad_limit,
            pv_frozen_limit=self.pv_frozen_limit,
            solver_limit=self.solver_limit,
            worse_by=self.worse_by,
        )


class Compensator(Controller, Protocol):
    """A controller with a valve model, as the supervisor needs it; `HybridMpc`, `EmbeddingMpc`."""

    @property
    def model(self) -> LoopModel:
        """The model in use."""

    @property
    def prediction(self) -> Prediction:
        """The process of the model."""

    @property
    def ready(self) -> bool:
        """Whether a PV was ever seen."""

    @property
    def is_moving(self) -> bool:
        """Whether the valve is being moved."""

    @property
    def horizon(self) -> int:
        """Samples that it looks ahead."""

    @property
    def held_variance(self) -> float:
        """Variance of PV that noise alone makes, the stem held."""

    def change_valve(self, valve: ValveModel) -> None:
        """Go on with other valve parameters."""

    def require_reachable(self, valve: ValveModel) -> tuple[float, float]:
        """Return the positions that moves can end at; raise `CompensatorError` if none is left."""


@dataclass(frozen=True, slots=True)
class _Sample:
    pv: float
    sp: float
    op: float
    by_base: bool


class Supervisor:
    """Base controller with a compensator on call; see the module's text.

    Args:
        base: the plant's controller (`UnawareMpc`, `PiController`).
        settings: of the supervisor and the compensator.
        build: makes the compensator of a model; `HybridMpc` with the settings' by default.
    """

    def __init__(
        self,
        base: Controller,
        settings: SupervisorSettings | None = None,
        build: Callable[[LoopModel], Compensator] | None = None,
    ) -> None:
        self.base = base
        self.settings = settings or SupervisorSettings()
        self._build: Callable[[LoopModel], Compensator] = build or (
            lambda model: HybridMpc(model, self.settings.hybrid)
        )
        self.state = SupervisorState.BASE
        self.reason = WithdrawReason.NONE
        self.refusal = ""
        self._compensator: Compensator | None = None
        self._next: Compensator | None = None
        self._goal: ValveModel | None = None
        self._given_up: LoopModel | None = None
        self._watch: LoopWatch | None = None
        self._history: deque[_Sample] = deque(maxlen=4 * self.settings.history)
        self._sp = math.nan
        self._bad_scans = 0
        self._screen = PvScreen(self.settings.pv_frozen_limit)
        self._unsolved = self._pauses = self._pause = 0

    @property
    def model(self) -> LoopModel | None:
        """The model in use, its friction on its way to the offered one; None without."""
        return None if self._compensator is None else self._compensator.model

    @property
    def compensating(self) -> bool:
        """Whether the compensator has the loop."""
        return self.state is SupervisorState.COMPENSATING

    def offer(self, model: LoopModel) -> bool:
        """Accept a model for compensation; return whether it is used.

        A model that was given up, or that no compensator can be built on, is refused: `reason` and
        `refusal` say why, and what was in use stays in use.
        """
        if model == self._given_up:
            self.refusal = "this model made the loop worse before; offer a newly identified one"
            return False
        current = self._next or self._compensator
        if current is not None and current.model.process == model.process:
            try:
                current.require_reachable(model.valve)
            except CompensatorError as error:
                return self._refuse(error)
            self._goal, self.refusal = model.valve, ""
            return True
        try:
            compensator = self._build(model)
        except CompensatorError as error:
            return self._refuse(error)
        for sample in list(self._history)[-self.settings.history :]:
            compensator.observe(sample.pv, sample.op)
        self._next, self._goal = compensator, model.valve
        self.reason, self.refusal = WithdrawReason.NONE, ""
        if self.state is SupervisorState.BASE:
            self.state = SupervisorState.WAITING
        return True

    def _refuse(self, error: CompensatorError) -> bool:
        self.refusal = str(error)
        if self._compensator is None and self._next is None:
            self.reason = WithdrawReason.REFUSED
        return False

    def withdraw(self, reason: WithdrawReason) -> None:
        """Give the loop back to the base controller, from the next scan on."""
        self._compensator = self._next = self._goal = self._watch = None
        self.reason = reason
        self.state = SupervisorState.BASE

    def step(self, pv: float, sp: float, op_applied: float, *, automatic: bool = True) -> Action:
        """Run one scan.

        Args:
            pv: measured now, NaN when bad.
            sp: set-point.
            op_applied: OP that was at the valve since the last scan, whoever set it.
            automatic: False while an operator has the loop; OP then follows ``op_applied``.
        """
        require_finite("Supervisor.step", sp=sp, op_applied=op_applied)
        pv = self._screened(pv)
        moved = abs(op_applied - self._history[-1].op) if self._history else 0.0
        by_base = automatic and not self.compensating
        self._history.append(_Sample(pv, sp, op_applied, by_base))
        for controller in (self.base, self._compensator, self._next):
            if controller is not None:
                controller.observe(pv, op_applied)
        self._bad_scans = 0 if math.isfinite(pv) else self._bad_scans + 1
        if not automatic:
            self._stand_by(SupervisorState.MANUAL)
            return Action(op_applied, ActionStatus.HOLDING, detail="manual")
        if self.state is SupervisorState.MANUAL:
            waiting = self._compensator is not None or self._next is not None
            self.state = SupervisorState.WAITING if waiting else SupervisorState.BASE
        if self._bad_scans > self.settings.pv_bad_limit and self.compensating:
            self._stand_by(SupervisorState.WAITING)
            frozen = self._screen.frozen
            self.reason = WithdrawReason.PV_FROZEN if frozen else WithdrawReason.PV_BAD
        self._ramp_frictions()
        if self._take_over():
            self._sp = sp
            return Action(op_applied, ActionStatus.HOLDING, detail="take-over")
        if not self.compensating:
            self._sp = sp
            return self.base.decide(sp)
        return self._compensate(pv, sp, op_applied, moved)

    def _screened(self, pv: float) -> float:
        """Return PV, NaN if it is frozen."""
        known = self._compensator or self._next
        if known is None or not known.ready:
            return self._screen.check(pv, 0.0, 1.0)
        return self._screen.check(pv, math.sqrt(known.held_variance), known.prediction.scale)

    def _compensate(self, pv: float, sp: float, op_applied: float, moved: float) -> Action:
        assert self._compensator is not None
        assert self._watch is not None
        if sp != self._sp:
            self._watch.restart(self._compensator.horizon // 2)
        self._sp = sp
        if math.isfinite(pv):
            verdict = self._watch.push(pv - sp, moved, self._compensator.held_variance)
            if verdict is not WatchVerdict.FINE:
                self._given_up = LoopModel(
                    self._goal or self._compensator.model.valve, self._compensator.model.process
                )
                self.withdraw(_GIVEN_UP[verdict])
                return Action(op_applied, ActionStatus.HOLDING, detail=verdict.value)
        action = self._compensator.decide(sp)
        failed = action.status is ActionStatus.SOLVER_FAILED
        self._unsolved = self._unsolved + 1 if failed else 0
        if self._unsolved >= self.settings.solver_limit:
            self._unsolved = 0
            self._pauses += 1
            if self._pauses > _PAUSES:
                self.withdraw(WithdrawReason.SOLVER)
            else:
                self._pause = self._compensator.horizon
                self._stand_by(SupervisorState.WAITING)
                self.reason = WithdrawReason.SOLVER
        return action

    def _stand_by(self, state: SupervisorState) -> None:
        """Let go of the loop but keep the model and go on observing."""
        self.state = state
        self._watch = None

    def _take_over(self) -> bool:
        """Switch to the compensator, or to a newer one, if the valve rests; tell whether."""
        candidate = self._next or (None if self.compensating else self._compensator)
        self._pause = max(0, self._pause - 1)
        if candidate is None or not candidate.ready or self._bad_scans or self._pause:
            return False
        if candidate.is_moving or (self._compensator is not None and self._compensator.is_moving):
            return False
        if self._watch is None:
            window = min(max(candidate.horizon, 40), self.settings.history // 2)
            self._watch = LoopWatch(self._before(window), self.settings.worse_by)
        self._watch.restart(candidate.horizon // 2)
        self._compensator, self._next = candidate, None
        self.state = SupervisorState.COMPENSATING
        if self.reason in _PASSING:
            self.reason = WithdrawReason.NONE
        return True

    def _before(self, window: int) -> LoopFigures | None:
        """Return the base controller's figures since the last SP change, None soon after one."""
        seen = list(self._history)
        changed = [k for k, s in enumerate(seen) if s.sp != seen[-1].sp or not s.by_base]
        recent = seen[changed[-1] + 1 + window // 2 :] if changed else seen
        errors = [s.pv - s.sp for s in recent if math.isfinite(s.pv)]
        if len(recent) < 2 * window or len(errors) < window:
            return None
        travel = sum(abs(b.op - a.op) for a, b in itertools.pairwise(recent))
        return LoopFigures(
            sum(e * e for e in errors) / len(errors),
            travel / len(recent),
            min(oscillation_period(errors, window), 0.5 * len(errors)),
        )

    def _ramp_frictions(self) -> None:
        """Move the compensator's fS and fD towards the offered ones while the valve rests."""
        for controller in (self._compensator, self._next):
            if controller is None or self._goal is None or controller.is_moving:
                continue
            have, goal, rate = controller.model.valve, self._goal, self.settings.friction_rate
            if have == goal:
                continue
            change_static = goal.static_friction - have.static_friction
            change_dynamic = goal.dynamic_friction - have.dynamic_friction
            if max(abs(change_static), abs(change_dynamic)) <= rate:
                controller.change_valve(goal)
                continue
            static = have.static_friction + min(max(change_static, -rate), rate)
            dynamic = have.dynamic_friction + min(max(change_dynamic, -rate), rate)
            # fD never passes fS on the way.
            controller.change_valve(ValveModel.from_friction(static, min(dynamic, static)))
