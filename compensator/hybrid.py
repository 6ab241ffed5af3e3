"""The stiction compensator that plans in valve positions, with the exact valve.

With stick band and slip jump known, ``OP = x* +/- fD`` puts the stem at any position ``x*`` at
least J away, and any OP inside the band leaves it where it is. So each scan: where is the stem
(`StemTracker`), which few moves bring PV to SP at the least cost (`MovePlanner`: the global
optimum, no warm start), then either the first move of the plan or OP in the middle of the band,
where no disturbance of OP can make it slip. A move has a price, set from the noise that the loop
shows: an error that noise explains is not worth a move.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from compensator.action import (
    Action,
    ActionStatus,
    CompensatorError,
    OpLimits,
    require_finite,
    require_not_negative,
)
from compensator.belief import FRICTION, GAIN, Belief
from compensator.moves import MovePlan, MovePlanner, Ramp
from compensator.prediction import NoiseModel, Prediction
from compensator.stem import StemTracker, TrackerSettings
from compensator.tracking import TrackerBank, noise_kinds
from loop_model import LoopModel, ValveModel

__all__ = ["HybridMpc", "HybridSettings"]

_EDGE = 0.85
"""Share of the static friction up to which OP may approach a slip without causing it."""
_UNKNOWN = 3.0
"""Weight of what is not yet known of the lasting offset, beside noise, in the price of a move."""


@dataclass(frozen=True, slots=True)
class HybridSettings:
    """Settings of `HybridMpc`.

    Attributes:
        limits: range and rate of OP.
        horizon: samples; 0 chooses it from the settling time.
        move_penalty: price of one move: the share of the noise's own variance by which it must
            lower PV's mean square error over the horizon.
        travel_penalty: price of moving by one slip jump, as a share of ``move_penalty``.
        noise_band: PV deviation that is of no interest (units of PV), added to the noise seen.
        slip_margin: moves are planned at least ``J + slip_margin * fS`` in size, so that they slip
            even if the static friction is somewhat above its estimate.
        overshoot: how far beyond its final position the stem may go for speed, as a share of the
            way there. The farther, the more the plan relies on the fast part of the process model.
        spread: relative uncertainty of fS and of fD.
        gain_spread: relative uncertainty of the process gain.
        offset_memory: settling times over which the load (what makes the controller free of offset)
            is averaged in quiet times.
        noise: ratios that set the filter (``disturbance`` is set by ``offset_memory``); None lets
            the loop's own noise decide (`TrackerBank`).
    """

    limits: OpLimits = field(default_factory=OpLimits)
    horizon: int = 0
    move_penalty: float = 1.0
    travel_penalty: float = 0.2
    noise_band: float = 0.0
    slip_margin: float = 0.2
    overshoot: float = 0.5
    spread: float = 0.1
    gain_spread: float = 0.1
    offset_memory: float = 2.0
    noise: NoiseModel | None = None

    def __post_init__(self) -> None:
        require_not_negative(
            "HybridSettings",
            horizon=self.horizon,
            move_penalty=self.move_penalty,
            travel_penalty=self.travel_penalty,
            noise_band=self.noise_band,
            slip_margin=self.slip_margin,
            overshoot=self.overshoot,
            spread=self.spread,
            gain_spread=self.gain_spread,
        )

    def with_limits(self, limits: OpLimits) -> HybridSettings:
        """Return the same settings with other limits of OP."""
        return replace(self, limits=limits)


class HybridMpc:
    """Compensating controller of a `LoopModel`; see the module's text.

    Args:
        model: valve and process, from a parameter block or from identification.
        settings: limits, prices, uncertainties.

    Raises:
        CompensatorError: the process cannot be controlled, or the valve's band leaves no position
            to move to inside the OP range.
    """

    def __init__(self, model: LoopModel, settings: HybridSettings | None = None) -> None:
        self.settings = settings or HybridSettings()
        self._model = model
        self._prediction = Prediction.of(model.process, "input")
        self.planner = MovePlanner(self.prediction, self.settings.horizon)
        noise = self.settings.noise
        noises = noise_kinds(self.prediction) if noise is None else (noise,)
        s = self.settings
        tracking = TrackerSettings(
            noises[0],
            spread=s.spread,
            gain_spread=s.gain_spread,
            offset_memory=s.offset_memory,
        )
        self._bank = TrackerBank(self.prediction, model.valve, tracking, noises)
        self._reach = self.require_reachable(model.valve)
        self._op = math.nan
        self._pv_bad = False
        self._moving = self.stem_moved = False

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
        return self.tracker.best.stem if self.tracker.ready else math.nan

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
    def is_moving(self) -> bool:
        """Whether the valve was moved by the last OP, or the plan is about to move it further."""
        return self._moving

    def change_valve(self, valve: ValveModel) -> None:
        """Go on with other valve parameters; stem, state and disturbance are kept."""
        self._reach = self.require_reachable(valve)
        self._bank.change_valve(valve)
        self._model = LoopModel(valve, self.model.process)

    def observe(self, pv: float, op: float) -> None:
        """See `Controller.observe`."""
        require_finite("HybridMpc.observe", op=op)
        self._pv_bad = not math.isfinite(pv)
        before = self.stem
        self._bank.observe(pv, op)
        self.stem_moved = self._moving = self.stem != before
        self._op = op

    def decide(self, sp: float) -> Action:
        """See `Controller.decide`."""
        require_finite("HybridMpc.decide", sp=sp)
        if not self.tracker.ready:
            return Action(self._op, ActionStatus.NOT_READY)
        if self._pv_bad:
            return Action(self._op, ActionStatus.PV_BAD)
        tracker = self.tracker
        belief = tracker.best
        plan = self.plan(sp)
        _, wanted = self.prediction.equilibrium(sp, 0.0)
        target = self._stem_for(belief, wanted - tracker.drive(belief), belief.direction)
        low, high = self._reach
        limited = not low <= target <= high
        target = min(max(target, low), high)
        self._moving = self._moving or bool(plan.times)
        if plan.times and plan.times[0] <= self._begins_at(belief, plan.changes[0]):
            change = plan.changes[0]
            position = self._slipping(belief, change)
            status = ActionStatus.LIMITED if limited else ActionStatus.MOVING
            op = self._move(belief, min(max(position, low), high))
        else:
            position = belief.stem
            status = ActionStatus.LIMITED if limited else ActionStatus.HOLDING
            op = self._hold(belief)
        return Action(op, status, target, plan.final_pv + sp, position, self._words(plan))

    def _stem_for(self, belief: Belief, change: float, direction: float) -> float:
        """Return the stem position that changes the process's drive by ``change``."""
        turned = belief.errors[FRICTION] * (direction - belief.direction)
        return float(belief.stem + (change - turned) / (1.0 + belief.errors[GAIN]))

    def _slipping(self, belief: Belief, change: float) -> float:
        """Return the stem position for a change of the drive.

        What is learnt of fD shifts where the stem lands, not the OP at which it breaks away: after
        a command that the valve has withstood, the next one goes far enough to slip.
        """
        side = math.copysign(1.0, change)
        position = self._stem_for(belief, change, side)
        if math.isfinite(belief.tested):
            least = self._smallest_move(belief)
            return belief.stem + side * max(side * (position - belief.stem), least)
        return position

    def _change_for(self, belief: Belief, position: float, direction: float) -> float:
        """Return the change of the process's drive that a stem position makes."""
        turned = belief.errors[FRICTION] * (direction - belief.direction)
        return float((position - belief.stem) * (1.0 + belief.errors[GAIN]) + turned)

    def plan(self, sp: float) -> MovePlan:
        """Return the best plan from the present belief for the set-point ``sp``."""
        tracker, s = self.tracker, self.settings
        belief = tracker.best
        error = self.planner.held_pv(tracker.free(belief), tracker.drive(belief)) - sp
        # The planner moves the process's drive; the stem moves it by a gain known a little better.
        gain = 1.0 + float(belief.errors[GAIN])
        smallest = self._smallest_move(belief)
        ramp = self._ramp(belief, smallest)
        move_cost, travel_cost = self.prices()
        _, wanted = self.prediction.equilibrium(sp, 0.0)
        way = wanted - tracker.drive(belief)
        beyond = gain * smallest + s.overshoot * abs(way)
        reach = (
            max(self._change_for(belief, self._reach[0], -1.0), min(0.0, way) - beyond),
            min(self._change_for(belief, self._reach[1], 1.0), max(0.0, way) + beyond),
        )
        ramp = replace(ramp, largest=gain * ramp.largest)
        return self.planner.plan(error, reach, gain * smallest, move_cost, travel_cost, ramp)

    def prices(self) -> tuple[float, float]:
        """Return the price of a move and of its size, in PV squared times samples."""
        tracker, s, valve = self.tracker, self.settings, self.model.valve
        smallest = self._smallest_move(tracker.best)
        # An offset not yet known well is no reason to move: waiting will tell.
        # A level drifts away from a wrong position, so that there a move cannot wait.
        weight = 1.0 if self.prediction.process.is_integrating else _UNKNOWN
        variance = tracker.held_variance + weight * tracker.offset_variance + s.noise_band**2
        # A floor for loops without noise: a thousandth of what one slip makes of PV.
        floor = (1e-3 * self.prediction.scale * max(smallest, 1e-3)) ** 2
        move_cost = s.move_penalty * max(variance, floor) * self.planner.duration
        travel_cost = s.travel_penalty * move_cost / max(smallest, valve.static_friction, 1e-9)
        return move_cost, travel_cost

    def plan_op(self, sp: float, samples: int) -> NDArray[np.float64]:
        """Return the OP, scan by scan, that carries out the present plan, shape ``(samples,)``."""
        plan, belief = self.plan(sp), self.tracker.best
        low, high = self._reach
        fd = self.model.valve.dynamic_friction
        path = np.empty(samples)
        stem, before = belief.stem, self._op
        moves = dict(zip(plan.times, plan.changes, strict=True))
        reached = 0.0
        for k in range(samples):
            wanted = stem
            if k in moves:
                side = math.copysign(1.0, moves[k] - reached)
                stem = min(max(self._stem_for(belief, moves[k], side), low), high)
                wanted, reached = stem + side * fd, moves[k]
            path[k] = before = self.settings.limits.clip(wanted, before)
        return path

    def _smallest_move(self, belief: Belief) -> float:
        """Return J and the margin above it; more after a command that the valve has withstood."""
        s, valve = self.settings, self.model.valve
        margin = s.slip_margin
        if belief.survived > 0.0:
            margin += s.spread * belief.survived
        if self._creeps:
            margin = 0.0  # OP goes on until the stem slips, whatever its friction
        return valve.slip_jump + margin * valve.static_friction

    @property
    def _creeps(self) -> bool:
        """Whether OP is too slow to leap over the uncertainty of the static friction."""
        s, valve = self.settings, self.model.valve
        return s.limits.rate < (1.0 - _EDGE + s.slip_margin) * valve.static_friction

    def _begins_at(self, belief: Belief, change: float) -> int:
        """Return the first move time of a plan that OP, set off now, can keep."""
        ramp = self._ramp(belief, self._smallest_move(belief))
        times = self.planner.times
        first = int(np.searchsorted(times, ramp.up if change > 0.0 else ramp.down))
        return int(times[min(first, times.size - 1)])

    def _ramp(self, belief: Belief, smallest: float) -> Ramp:
        """Return what OP's rate limit means for moves from here: OP has to travel to the edge of
        the band first, a slip begins from there with one scan's worth of rate, and after it OP
        stands fD away from the stem.
        """
        rate, valve = self.settings.limits.rate, self.model.valve
        if math.isinf(rate):
            return Ramp()
        fd, lead = valve.dynamic_friction, self._op - belief.stem

        def scans(way: float) -> int:
            return max(0, math.ceil(min(way / rate, 1e6) - 1e-9))

        return Ramp(
            up=max(0, scans(smallest + fd - lead) - 1),
            down=max(0, scans(smallest + fd + lead) - 1),
            same=max(1, scans(smallest)),
            opposite=max(1, scans(smallest + 2.0 * fd)),
            largest=smallest + rate if self._creeps else _EDGE * valve.static_friction + rate - fd,
        )

    def _move(self, belief: Belief, position: float) -> float:
        """Return the OP that moves the stem to ``position``, as far as the rate limit lets it."""
        valve, limits = self.model.valve, self.settings.limits
        side = math.copysign(1.0, position - belief.stem)
        wanted = position + side * valve.dynamic_friction
        op = limits.clip(wanted, self._op)
        if self._creeps:
            # From here one scan's worth of rate slips, and lands where it should.
            ahead = min((wanted - belief.stem) * side - limits.rate, 0.97 * valve.static_friction)
            way = ahead - (self._op - belief.stem) * side
            step = way if 0.1 * limits.rate < way < limits.rate else limits.rate
            return limits.clip(self._op + side * step, self._op)
        edge = belief.stem + side * _EDGE * valve.static_friction
        slips_early = op != wanted and (op - edge) * side > 0.0
        if slips_early and (self._op - edge) * side < -1e-9:
            # Too slow to do it in one go: wait at the band's edge, then jump from there.
            return limits.clip(edge, self._op)
        return op

    def _hold(self, belief: Belief) -> float:
        """Return the middle of the band, the OP that no disturbance turns into a slip."""
        return self.settings.limits.clip(belief.stem, self._op)

    @staticmethod
    def _words(plan: MovePlan) -> str:
        if not plan.times:
            return "hold"
        return "; ".join(
            f"{change:+.4g} in {time} samples"
            for time, change in zip(plan.times, plan.changes, strict=True)
        )
