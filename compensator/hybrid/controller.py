"""The stiction compensator that plans in valve positions, with the exact valve.

With stick band and slip jump known, ``OP = x* +/- fD`` puts the stem at any position ``x*`` at
least J away, and any OP inside the band leaves it where it is. So each scan: where is the stem
(`StemTracker`), which few moves bring PV to SP at the least cost (`MovePlanner`: the global
optimum, no warm start), then either the first move of the plan or OP in the middle of the band,
where no disturbance of OP can make it slip. A move has a price (`MovePrices`).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from compensator.action import (
    Action,
    ActionStatus,
    CompensatorError,
    as_measured,
    require_finite,
)
from compensator.hybrid.load_trend import LoadTrend
from compensator.hybrid.move_prices import MovePrices
from compensator.hybrid.moves import MovePlan, MovePlanner, Ramp
from compensator.hybrid.setpoint_trend import SetpointTrend
from compensator.hybrid.settings import HybridSettings
from compensator.hybrid.slow_lags import as_planned
from compensator.hybrid.sure_moves import SureMoves, plausible_stems
from compensator.prediction import LONGEST_DEAD_TIME, NoiseModel, Prediction
from compensator.stem_tracking.friction import Uncertainty
from compensator.stem_tracking.stem import StemTracker
from compensator.stem_tracking.tracker_settings import TrackerSettings
from compensator.stem_tracking.tracking import TrackerBank, noise_kinds
from loop_model import LoopModel, ValveModel

__all__ = ["HybridMpc", "HybridSettings"]


class HybridMpc:
    """Compensating controller of a `LoopModel`; see the module's text.

    Args:
        model: valve and process, from a parameter block or from identification.
        settings: limits, prices, least uncertainties.
        uncertainty: of the friction, as the identification states it.

    Raises:
        CompensatorError: the process cannot be controlled, or the valve's band leaves no position
            to move to inside the OP range.
    """

    def __init__(
        self,
        model: LoopModel,
        settings: HybridSettings | None = None,
        uncertainty: Uncertainty | None = None,
    ) -> None:
        self.settings = settings or HybridSettings()
        self._model = model
        process = as_planned(model.process, self.settings.level_horizon)
        self._prediction = Prediction.of(process, "input")
        if 0 < self.settings.horizon <= self._prediction.dead_time:
            raise CompensatorError(
                f"a horizon of {self.settings.horizon} samples ends before the dead time of "
                f"{self._prediction.dead_time}; use 0, which chooses one"
            )
        s = self.settings
        noises = noise_kinds(self.prediction) if s.noise is None else (s.noise,)
        beyond = (s.horizon or LONGEST_DEAD_TIME + 1) - self._prediction.dead_time
        tracking = TrackerSettings(
            noises[0],
            friction=s.friction_prior(uncertainty or Uncertainty()),
            gain_spread=s.gain_spread,
            offset_memory=s.offset_memory,
            late=tuple(samples for samples in s.late if samples < beyond),
            jump_late=tuple(samples for samples in s.jump_late if samples < beyond),
        )
        self._bank = TrackerBank(self.prediction, model.valve, tracking, noises)
        self._planners = {
            p.dead_time: tuple(MovePlanner(p, s, on_ramp=on_ramp) for on_ramp in (False, True))
            for p in self._bank.predictions.values()
        }
        self.planner = self._planners[self.prediction.dead_time][0]
        self._reach = self.require_reachable(model.valve)
        self._op = math.nan
        self._pv_bad = False
        self._prices = MovePrices(s, self.prediction, self.planner.duration)
        self._moving = self.stem_moved = False
        self._dwells = self._lingers = 0
        self._trend = SetpointTrend(self.horizon // 2, self.settings.trend)
        dead_time, settling = self.prediction.dead_time, self.planner.settling
        self._load_trend = LoadTrend(dead_time, settling, self.settings.load_trend)
        self._way = 0.0
        self._limited = False

    def require_reachable(self, valve: ValveModel) -> tuple[float, float]:
        """Return the positions that moves can end at; raise `CompensatorError` if none is left."""
        limits, fd = self.settings.limits, valve.dynamic_friction
        low, high = limits.low + fd, limits.high - fd
        if high - low < valve.slip_jump:
            raise CompensatorError(
                f"a stick band of {valve.stick_band:g} leaves no position to move to inside the OP "
                f"range {limits.low:g} to {limits.high:g}; check the band's units and the limits"
            )
        return low, high

    @property
    def tracker(self) -> StemTracker:
        """What is believed of stem, state, load and noise."""
        return self._bank.chosen

    @property
    def noise(self) -> NoiseModel:
        """The noise model in use."""
        return self._bank.noise

    @property
    def reach(self) -> tuple[float, float]:
        """Lowest and highest position that moves can end at."""
        return self._reach

    @property
    def stem(self) -> float:
        """Stem position believed now; NaN before the first observation."""
        return self.tracker.stem if self.tracker.ready else math.nan

    @property
    def model(self) -> LoopModel:
        """The model in use."""
        return self._model

    @property
    def prediction(self) -> Prediction:
        """The process, its disturbance at the input."""
        return self._prediction

    @property
    def ready(self) -> bool:
        """Whether a PV was ever seen."""
        return self.tracker.ready

    @property
    def horizon(self) -> int:
        """Samples that a plan looks ahead."""
        return self.planner.horizon

    @property
    def held_variance(self) -> float:
        """Variance of PV that the noise seen so far makes with the stem held (PV squared)."""
        return self.tracker.held_variance

    @property
    def load_stepped(self) -> bool:
        """Whether the last PV showed a step of the load."""
        return self.tracker.load_stepped

    @property
    def opposed(self) -> bool:
        """Whether PV answers to OP against the sign of the model's gain."""
        return self._bank.opposed

    @property
    def is_moving(self) -> bool:
        """Whether the valve was moved by the last OP, or the plan is about to move it further."""
        return self._moving

    def improve_on(self, deviation: float, travel: float) -> None:
        """Take in PV's deviation and the stem's travel per scan before compensation: a small share
        of the deviation is worth no move, and travel is saved where PV is good enough.
        """
        self._prices.improve_on(deviation, travel, self.horizon)

    def change_valve(self, valve: ValveModel) -> None:
        """Go on with other valve parameters; stem, state and disturbance are kept."""
        self._reach = self.require_reachable(valve)
        self._bank.change_valve(valve)
        self._model = LoopModel(valve, self.model.process)

    def observe(self, pv: float, op: float) -> None:
        """See `Controller.observe`."""
        require_finite("HybridMpc.observe", op=op)
        pv = as_measured(pv)
        self._pv_bad = not math.isfinite(pv)
        before = self.stem
        self._bank.observe(pv, op)
        self.stem_moved = self._moving = self.stem != before
        self._way = abs(self.stem - before) if self.ready and math.isfinite(before) else 0.0
        self._dwells = max(0, self._dwells - 1)
        self._lingers = max(0, self._lingers - 1)
        if self.ready and self.stem_moved and self.tracker.best.way:
            self._dwells = self.settings.dwell - 1
            self._lingers = self.settings.linger - 1
        self._op = op
        if self.ready:
            self._follow_load()

    def _follow_load(self) -> None:
        """Look for a drift in the stem's balance position, the set-point's part left out."""
        tracker = self.tracker
        moves = self._moves()
        balance = moves.stem_for(-tracker.drive(tracker.best), tracker.best.direction)
        doubt = math.sqrt(tracker.offset_variance) / tracker.prediction.scale
        self._load_trend.push(balance, doubt, moves.smallest, tracker)

    def decide(self, sp: float) -> Action:
        """See `Controller.decide`."""
        require_finite("HybridMpc.decide", sp=sp)
        self._trend.push(sp)
        if not self.tracker.ready:
            return Action(self._op, ActionStatus.NOT_READY)
        if self._pv_bad:
            return Action(self._op, ActionStatus.PV_BAD)
        tracker = self.tracker
        belief = tracker.best
        self._prices.follow(tracker, sp, self._way, in_reach=not self._limited)
        plan = self.plan(sp)
        _, wanted = self.prediction.equilibrium(sp, 0.0)
        moves = self._moves()
        target = moves.stem_for(wanted - tracker.drive(belief), belief.direction)
        low, high = self._reach
        limited = self._limited = not low <= target <= high
        target = min(max(target, low), high)
        self._moving = self._moving or bool(plan.times) or self._dwells > 0
        goes_on = bool(plan.times) and plan.changes[0] * belief.direction > 0.0
        if self._dwells and not goes_on:
            position, op = belief.stem, moves.strokes.dwell()
            status = ActionStatus.LIMITED if limited else ActionStatus.MOVING
        elif plan.times and plan.times[0] <= self._begins_at(moves.strokes.ramp(), plan.changes[0]):
            change = plan.changes[0]
            position = moves.slipping(change)
            status = ActionStatus.LIMITED if limited else ActionStatus.MOVING
            op = moves.strokes.move(min(max(position, low), high))
        else:
            position = belief.stem
            status = ActionStatus.LIMITED if limited else ActionStatus.HOLDING
            op = moves.strokes.dwell() if self._lingers else moves.strokes.hold()
        return Action(op, status, target, plan.final_pv + sp, position, self._words(plan))

    def plan(self, sp: float) -> MovePlan:
        """Return the best plan from the present belief for the set-point ``sp``."""
        tracker, s = self.tracker, self.settings
        belief = tracker.best
        planner, ramp_planner = self._planners[tracker.prediction.dead_time]
        ahead = self._trend.ahead(planner.points)
        error = planner.held_pv(tracker.free(belief), tracker.drive(belief)) - (sp + ahead)
        moves = self._moves()
        error = error + self._load_trend.ahead(planner.ramp_response)
        least = moves.least()
        ramp = moves.strokes.ramp()
        ramp = replace(
            ramp,
            up=max(ramp.up, 0 if belief.direction > 0.0 else self._dwells),
            down=max(ramp.down, 0 if belief.direction < 0.0 else self._dwells),
            largest=moves.gain * ramp.largest,
        )
        move_cost, travel_cost = self.prices()
        _, wanted = self.prediction.equilibrium(sp, 0.0)
        _, later = self.prediction.equilibrium(sp + float(ahead[-1]), 0.0)
        ways = (0.0, wanted - tracker.drive(belief), later - tracker.drive(belief))
        overshoot = s.overshoot * max(map(abs, ways))
        lowest = min(ways) - overshoot - max(least.on, least.down)
        highest = max(ways) + overshoot + max(least.on, least.up)
        reach = (
            max(moves.change_for(self._reach[0], -1.0), lowest),
            min(moves.change_for(self._reach[1], 1.0), highest),
        )
        settles = not self.prediction.process.is_integrating
        restless = tracker.settings.load_walk
        if self._trend.turns or (restless and settles):
            # What comes next tells whether a way there and back is needed.
            ramp = replace(ramp, opposite=self.horizon)
        # A correction is worth it for as long as the load stays, where it does not rest.
        worth = max(1.0, planner.duration / self._load_trend.lasts(restless))
        move_cost, travel_cost = worth * move_cost, worth * travel_cost
        drifts = self._trend.is_ramp or self._load_trend.drifts
        if not (drifts and settles):
            # On a ramp a level needs the stem elsewhere for as long as it lasts, and no longer.
            within = math.inf if settles else self._trend.lasts(self.horizon)
            return planner.plan(error, reach, least, move_cost, travel_cost, ramp, within)
        # Set-point or load pass by each position of the stem: a way there and back gains nothing.
        ramp = replace(ramp, opposite=self.horizon)
        step = moves.smallest * self.prediction.scale
        dead_time, settling = tracker.prediction.dead_time, planner.settling
        within = self._trend.window(dead_time, settling, step)
        within = min(within, self._load_trend.window(moves.smallest))
        return ramp_planner.plan(error, reach, least, move_cost, travel_cost, ramp, within)

    def prices(self) -> tuple[float, float]:
        """Return the price of a move and of its size, in PV squared times samples."""
        return self._prices.of_move(self.tracker, self._moves().smallest)

    def plan_op(self, sp: float, samples: int) -> NDArray[np.float64]:
        """Return the OP, scan by scan, that carries out the present plan, shape ``(samples,)``."""
        plan, sure = self.plan(sp), self._moves()
        low, high = self._reach
        fd = self.tracker.valve.dynamic_friction
        path = np.empty(samples)
        stem, before = sure.belief.stem, self._op
        moves = dict(zip(plan.times, plan.changes, strict=True))
        reached = 0.0
        for k in range(samples):
            wanted = stem
            if k in moves:
                side = math.copysign(1.0, moves[k] - reached)
                stem = min(max(sure.stem_for(moves[k], side), low), high)
                wanted, reached = stem + side * fd, moves[k]
            path[k] = before = self.settings.limits.clip(wanted, before)
        return path

    def _moves(self) -> SureMoves:
        """Return what moves there are from the present belief."""
        tracker = self.tracker
        stems = plausible_stems(tracker.stems, tracker.chances)
        return SureMoves(self.settings, tracker.valve, tracker.best, stems, self._reach, self._op)

    def _begins_at(self, ramp: Ramp, change: float) -> int:
        """Return the first move time of a plan that OP, set off now, can keep."""
        times = self._planners[self.tracker.prediction.dead_time][0].times
        first = int(np.searchsorted(times, ramp.up if change > 0.0 else ramp.down))
        return int(times[min(first, times.size - 1)])

    @staticmethod
    def _words(plan: MovePlan) -> str:
        if not plan.times:
            return "hold"
        return "; ".join(
            f"{change:+.4g} in {time} samples"
            for time, change in zip(plan.times, plan.changes, strict=True)
        )
