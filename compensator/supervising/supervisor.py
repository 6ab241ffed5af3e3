"""Who has the loop: the plant's own controller, or the compensator while its model is good.

Both controllers observe every scan, so either can take over at any scan, and on the scan of a
change OP stays where it is. A model is offered (from a parameter block) and withdrawn; the
supervisor decides when to switch. Rules:

* never while the valve is being moved;
* the first model is taken as it is, later ones change fS and fD at a limited rate; a changed
  process means a new compensator, which first relives the recent history;
* the compensated loop is compared with itself before, across manual and set-point changes; when it
  is worse, runs away, hunts or travels too far, the base controller gets the loop back and that
  model is not tried again until it has changed or time has passed;
* PV bad or frozen for long, a solver that keeps passing its bound, expiry, a dead heartbeat or an
  operator do the same; the reason stays visible.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from compensator.action import (
    Action,
    ActionStatus,
    CompensatorError,
    Controller,
    RefusalKind,
    as_measured,
    require_finite,
)
from compensator.hybrid.controller import HybridMpc
from compensator.prediction import Prediction, settling_samples
from compensator.stem_tracking.friction import Uncertainty
from compensator.supervising.admission import Admission
from compensator.supervising.figures import LoopFigures, LoopRecord, Sample
from compensator.supervising.jumps import JumpScreen, span_of, without_jumps
from compensator.supervising.loop_judge import LoopJudge
from compensator.supervising.reasons import PASSING, REASONS, REFUSALS
from compensator.supervising.recess import Recess
from compensator.supervising.reliving import Reliving
from compensator.supervising.screen import PvScreen
from compensator.supervising.supervision import (
    Compensator,
    LoopMemory,
    SupervisorSettings,
    SupervisorState,
    WithdrawReason,
)
from compensator.supervising.valve_ramp import step_towards
from compensator.supervising.watch import WatchVerdict
from loop_model import LoopModel, ValveModel

__all__ = ["Supervisor"]

_PAUSES = 3
"""Pauses that an overtaxed solver is given before it is given up."""

_ROUNDED = 0.01
"""Share of OP's range by which OP may be read outside of it: registers round, PLCs smooth."""


class Supervisor:
    """Base controller with a compensator on call; see the module's text.

    Args:
        base: the plant's controller (`UnawareMpc`, `PiController`).
        settings: of the supervisor and the compensator.
        build: makes the compensator of a model and what is stated of its uncertainty; `HybridMpc`
            with the settings' by default.
    """

    def __init__(
        self,
        base: Controller,
        settings: SupervisorSettings | None = None,
        build: Callable[[LoopModel, Uncertainty], Compensator] | None = None,
    ) -> None:
        self.base = base
        self.settings = settings or SupervisorSettings()
        self._build: Callable[[LoopModel, Uncertainty], Compensator] = build or (
            lambda model, uncertainty: HybridMpc(model, self.settings.hybrid, uncertainty)
        )
        self.state = SupervisorState.BASE
        self.reason = WithdrawReason.NONE
        self.refusal = ""
        self.refused = RefusalKind.NONE
        self._compensator: Compensator | None = None
        self._next: Compensator | None = None
        self._reliving = Reliving(self.settings.relived)
        self._queued: tuple[LoopModel, Uncertainty] | None = None
        self._chances = 0
        self._goal: ValveModel | None = None
        self._offered: LoopModel | None = None
        self._uncertainty = Uncertainty()
        self._admission = Admission(self.settings)
        self._known: LoopFigures | None = None
        self._record = LoopRecord(4 * self.settings.history)
        self._judge = LoopJudge(self.settings, self._record)
        self._screen = PvScreen(self.settings.pv_frozen_limit)
        self._jumps = JumpScreen(self.settings.jump)
        self._recess = Recess(self.settings.least_known, self.settings.history)
        self._stem = math.nan
        self._bad_scans = 0
        self._unsolved = self._pauses = self._pause = 0

    @property
    def model(self) -> LoopModel | None:
        """The model in use, its friction on its way to the offered one; None without."""
        return None if self._compensator is None else self._compensator.model

    @property
    def compensating(self) -> bool:
        """Whether the compensator has the loop."""
        return self.state is SupervisorState.COMPENSATING

    @property
    def memory(self) -> LoopMemory:
        """What to keep over a restart."""
        return LoopMemory(self._known, self._admission.given_up.known, self._admission.gain_sign)

    def restore(self, memory: LoopMemory) -> None:
        """Go on with what was known before a restart."""
        self._known = memory.figures
        self._admission.given_up.restore(memory.given_up)
        self._admission.gain_sign = memory.gain_sign

    def offer(self, model: LoopModel, uncertainty: Uncertainty | None = None) -> bool:
        """Accept a model for compensation; return whether it is used.

        A model that was given up, or that no compensator can be built on, is refused: `reason` and
        `refusal` say why, and what was in use stays in use.

        Args:
            model: valve and process.
            uncertainty: of the friction, as the identification states it.
        """
        stated = uncertainty or Uncertainty()
        try:
            self._admission.require_usable(model)
            self._leave_out_jumps(model)
            self._admission.require_right_sign(model, self._record.all)
            offered, model = model, self._admission.with_seen_friction(model, self._record.all)
            current = self._next or self._compensator
            if current is not None and current.model.process == model.process:
                current.require_reachable(model.valve)
                self._queued = None
                self._goal, self._offered, self._uncertainty = model.valve, offered, stated
                self.refusal, self.refused = "", RefusalKind.NONE
                return True
            if self._is_busy():
                self._queued = offered, stated
                return True
            compensator = self._build(model, stated)
            if len(self._record) >= self.settings.check.shortest:
                process = compensator.prediction.process
                before = self._figures(compensator)
                self._admission.require_fine_enough(model.valve, process, before)
        except CompensatorError as error:
            self.refusal, self.refused = str(error), error.kind
            if self._compensator is None and self._next is None:
                self.reason = WithdrawReason.REFUSED
            return False
        self._reliving.begin(self._record.latest(self.settings.history))
        self._chances = self.settings.least_known
        self._next, self._goal = compensator, model.valve
        self._offered, self._uncertainty = offered, stated
        self.reason, self.refusal = WithdrawReason.NONE, ""
        self.refused = RefusalKind.NONE
        if self.state is SupervisorState.BASE:
            self.state = SupervisorState.WAITING
        return True

    def withdraw(self, reason: WithdrawReason) -> None:
        """Give the loop back to the base controller, from the next scan on."""
        self._compensator = self._next = self._goal = self._queued = None
        self._reliving.forget()
        self._chances = 0
        self._judge.forget()
        self.reason = reason
        self.refused = REFUSALS.get(reason, RefusalKind.NONE)
        self.state = SupervisorState.BASE

    def step(self, pv: float, sp: float, op_applied: float, *, automatic: bool = True) -> Action:
        """Run one scan.

        Args:
            pv: measured now, NaN when bad.
            sp: set-point.
            op_applied: OP that was at the valve since the last scan, from any source.
            automatic: False while an operator has the loop; OP then follows ``op_applied``.
        """
        require_finite("Supervisor.step", sp=sp, op_applied=op_applied)
        pv = self._screened(pv, op_applied)
        moved = self._move_stem(op_applied)
        known = math.inf if self._known is None else self._known.largest
        self._recess.follow(pv - sp, self.settings.watch.limit_trip * known)
        by_base = automatic and not self.compensating and self._recess.over
        sample = Sample(pv, sp, op_applied, by_base)
        # A fault and what it leads to contradict no model.
        told = self._recess.over or self.reason is WithdrawReason.LOAD
        self._record.push(sample if told else replace(sample, pv=math.nan))
        self._admission.given_up.pass_scan()
        for controller in (self.base, self._compensator):
            if controller is not None:
                controller.observe(pv, op_applied)
        self._relive(sample)
        self._bad_scans = 0 if math.isfinite(pv) else self._bad_scans + 1
        if not automatic:
            self.state = SupervisorState.MANUAL
            return Action(op_applied, ActionStatus.HOLDING, detail="manual")
        if self.state is SupervisorState.MANUAL:
            waiting = self._compensator is not None or self._next is not None
            self.state = SupervisorState.WAITING if waiting else SupervisorState.BASE
        if self._bad_scans > self.settings.pv_bad_limit and self.compensating:
            self.state = SupervisorState.WAITING
            frozen = self._screen.frozen
            self.reason = WithdrawReason.PV_FROZEN if frozen else WithdrawReason.PV_BAD
        if self.compensating and not self.settings.hybrid.limits.holds(op_applied, _ROUNDED):
            self.state, self.reason = SupervisorState.WAITING, WithdrawReason.OP_OUTSIDE
        self._ramp_frictions()
        if self._take_over(op_applied):
            self._judge.follow(sp)
            return Action(op_applied, ActionStatus.HOLDING, detail="take-over")
        if not self.compensating:
            self._judge.follow(sp)
            return self.base.decide(sp)
        return self._compensate(pv, sp, op_applied, moved)

    def _relive(self, sample: Sample) -> None:
        """Let the next compensator follow the loop; begin with what was offered meanwhile once the
        one before has had its chances to take over, and its trial.
        """
        if self._next is not None:
            self._reliving.observe(self._next, sample)
        if self._reliving.done:
            self._chances = 0 if self._next is None else max(0, self._chances - 1)
        if self._queued is not None and not self._is_busy():
            (queued, self._queued), reason = (self._queued, None), self.reason
            if not self.offer(*queued) and self.reason is WithdrawReason.REFUSED:
                self.reason = reason  # why the model before was given up

    def _is_busy(self) -> bool:
        """Whether a newer model has to wait: for one that relives the past or is about to take
        over, or for the watch to judge the one in use. Each take-over begins a watch, so that
        models which came sooner than one can be judged would never be.
        """
        on_trial = self.compensating and self._judge.on_trial
        return not self._reliving.done or self._chances > 0 or on_trial

    def _leave_out_jumps(self, model: LoopModel) -> None:
        """Look for jumps in the record from before any model was there."""
        if self._compensator is not None or self._next is not None:
            return
        prediction = Prediction.of(model.process, "input")
        horizon = settling_samples(prediction)
        screen = self._jumps = JumpScreen(self.settings.jump)
        samples = without_jumps(self._record.all, prediction, model.valve, horizon, screen)
        self._record.replace(samples)

    def _move_stem(self, op: float) -> float:
        """Return how far OP moves the stem, by the same model before and after the take-over."""
        if self._compensator is None:
            self._stem = op
            return 0.0
        before, self._stem = self._stem, self._compensator.model.valve.step(self._stem, op)
        return abs(self._stem - before)

    def _screened(self, pv: float, op: float) -> float:
        """Return PV, NaN if it is frozen, or jumped, or was never measured."""
        pv = as_measured(pv)
        known = self._compensator or self._next
        if known is None:
            return self._screen.check(pv, 0.0, 1.0)
        follows = known.ready and (known is self._compensator or self._reliving.done)
        noise = math.sqrt(known.held_variance) if follows else 0.0
        pv = self._screen.check(pv, noise, known.prediction.scale)

        def op_span() -> float:
            return span_of([*self._record.latest(known.horizon), Sample(pv, 0.0, op, True)])

        seen = self._jumps.check(pv, known.prediction, known.model.valve, op_span)
        if self._jumps.believed:
            self._start_afresh(known)
        return seen

    def _start_afresh(self, known: Compensator) -> None:
        """Give the loop back after a jump that stays: what ``known`` followed is no longer what PV
        shows, so another compensator of its model finds stem and load again.
        """
        if self.compensating:
            self.state, self.reason = SupervisorState.WAITING, WithdrawReason.PV_BAD
        self._compensator, self._next = None, self._build(known.model, self._uncertainty)
        self._reliving.forget()
        self._judge.forget()
        self._recess.begin(max(known.horizon, self.settings.least_known))

    def _compensate(self, pv: float, sp: float, op_applied: float, moved: float) -> Action:
        assert self._compensator is not None
        verdict = self._judge.push(self._compensator, pv, sp, op_applied, moved, self._stem)
        if verdict is WatchVerdict.LEFT_RANGE and self._judge.load_did_it(self._compensator):
            self.state, self.reason = SupervisorState.WAITING, WithdrawReason.LOAD
            self._recess.begin(self._compensator.horizon)
            self._judge.forget()
            return Action(op_applied, ActionStatus.HOLDING, detail=WithdrawReason.LOAD.value)
        if verdict is not WatchVerdict.FINE:
            self._admission.given_up.add(
                self._offered or self._compensator.model,
                self._uncertainty,
                REFUSALS[REASONS[verdict]],
            )
            queued = self._queued
            self.withdraw(REASONS[verdict])
            self._queued = queued
            return Action(op_applied, ActionStatus.HOLDING, detail=verdict.value)
        action = self._compensator.decide(sp)
        self._judge.limited = action.status is ActionStatus.LIMITED
        failed = action.status is ActionStatus.SOLVER_FAILED
        self._unsolved = self._unsolved + 1 if failed else 0
        if self._unsolved >= self.settings.solver_limit:
            self._unsolved = 0
            self._pauses += 1
            if self._pauses > _PAUSES:
                self.withdraw(WithdrawReason.SOLVER)
            else:
                self._pause = self._compensator.horizon
                self.state = SupervisorState.WAITING
                self.reason = WithdrawReason.SOLVER
        return action

    def _take_over(self, op: float) -> bool:
        """Switch to the compensator, or to a newer one, if the valve rests; tell whether."""
        candidate = self._next or (None if self.compensating else self._compensator)
        self._pause = max(0, self._pause - 1)
        if not (self._reliving.done and self._recess.over):
            return False
        if candidate is None or not candidate.ready or self._bad_scans or self._pause:
            return False
        if candidate.is_moving or (self._compensator is not None and self._compensator.is_moving):
            return False
        known_scans = self.settings.least_known + candidate.prediction.dead_time
        if len(self._record) < known_scans:
            return False
        if not self.settings.hybrid.limits.holds(op, 1e-6):
            if not self.compensating:
                self.reason = WithdrawReason.OP_OUTSIDE
            return False
        before = self._figures(candidate)
        if before is None or not self._accept(candidate):
            return False
        self._judge.begin(before, candidate)
        candidate.improve_on(math.sqrt(before.mean_square), before.travel)
        self._compensator, self._next, self._chances = candidate, None, 0
        self.state = SupervisorState.COMPENSATING
        if self.reason in PASSING:
            self.reason = WithdrawReason.NONE
        return True

    def _accept(self, candidate: Compensator) -> bool:
        """Refuse a candidate that the record contradicts by now; tell whether it may take over."""
        if candidate is self._compensator:
            return True
        try:
            self._admission.require_right_sign(candidate.model, self._record.all)
        except CompensatorError as error:
            if self._compensator is None:
                self.withdraw(WithdrawReason.REFUSED)
            self._next = None
            self.refusal, self.refused = str(error), error.kind
            return False
        return True

    def _figures(self, candidate: Compensator) -> LoopFigures | None:
        """Return what the loop was like before: of late, or else what is known of old.

        Figures of a stretch that is long enough take the place of older ones; so nothing that an
        operator or a restart does makes the watch blind.
        """
        window = min(max(candidate.horizon, 40), self.settings.history // 2)
        valve = candidate.model.valve
        lasting = self._record.figures(window, 2 * window, valve)
        if lasting is not None:
            self._known = lasting
        elif self._known is None:
            self._known = self._record.figures(window, self.settings.least_known, valve)
        return self._known

    def _ramp_frictions(self) -> None:
        """Move the compensator's fS and fD towards the offered ones while the valve rests."""
        for controller in (self._compensator, self._next):
            if controller is None or self._goal is None or controller.is_moving:
                continue
            if controller is self._next and not self._reliving.done:
                continue
            have, goal, rate = controller.model.valve, self._goal, self.settings.friction_rate
            if have == goal:
                continue
            controller.change_valve(step_towards(have, goal, rate))
