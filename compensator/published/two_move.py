"""The two-move method: put the stem where PV settles at SP, with two moves, and leave it there.

Srinivasan, R. and Rengaswamy, R. (2008), *Approaches for efficient stiction compensation in process
control valves*, Comput. Chem. Eng. 32, 218-229: the first move takes the stem away from where it
sticks, the second, in the other direction, to the position of the steady state; then OP is held.
The method is open loop and takes that position as known. Two things are taken from those who made
it work on plants: the position is estimated (Bacci di Capaci, R., Scali, C. and Huang, B. (2016),
*A revised technique of stiction compensation for control valves*, IFAC-PapersOnLine 49(7),
1038-1043: from the mean of OP over the oscillation), and it moves again when PV has settled
elsewhere than at SP (Cuadros, M. A. de S. L., Munaro, C. J. and Munareto, S. (2012), *Improved
stiction compensation in pneumatic control valves*, Comput. Chem. Eng. 38, 106-114: compensation
stops while the error is small). The new position follows from the model's gain.

It is here as a peer to measure against. Open loop, it can hold self-regulating processes only.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from enum import Enum, auto

import numpy as np

from compensator.action import (
    Action,
    ActionStatus,
    CompensatorError,
    OpLimits,
    require_finite,
    require_positive,
)
from compensator.prediction import Prediction, settling_samples
from loop_model import LoopModel

__all__ = ["TwoMove", "TwoMoveSettings"]


@dataclass(frozen=True, slots=True)
class TwoMoveSettings:
    """Settings of `TwoMove`.

    Attributes:
        limits: range and rate of OP.
        tolerance: mean error, in standard deviations that PV has over the same samples, beyond
            which the stem is moved again.
        margin: how much farther than the slip jump the stem is taken, as a share of fS, so that it
            slips even if the static friction is somewhat above its estimate.
        average: samples over which the error is averaged once PV has settled; 0 takes the settling
            time, at least 20.
    """

    limits: OpLimits = field(default_factory=OpLimits)
    tolerance: float = 1.0
    margin: float = 0.2
    average: int = 0

    def __post_init__(self) -> None:
        require_positive("TwoMoveSettings", tolerance=self.tolerance, margin=self.margin)
        if self.average < 0:
            raise CompensatorError(
                f"TwoMoveSettings: average must not be negative; got {self.average}"
            )


class _Phase(Enum):
    AWAY = auto()
    TO_TARGET = auto()
    HOLD = auto()


class TwoMove:
    """The two-move method; see the module's text.

    Args:
        model: valve and process; of the process the gain and the settling time are used.
        settings: limits, when to move again.

    Raises:
        CompensatorError: the process is integrating.
    """

    def __init__(self, model: LoopModel, settings: TwoMoveSettings | None = None) -> None:
        if model.process.is_integrating:
            raise CompensatorError(
                "the two-move method holds OP in open loop; an integrating process drifts away "
                "from any held OP: use the hybrid compensator"
            )
        self.settings = settings or TwoMoveSettings()
        self.model = model
        prediction = Prediction.of(model.process)
        self._settle = settling_samples(prediction)
        self._average = self.settings.average or max(20, self._settle)
        self._before: deque[float] = deque(maxlen=4 * self._settle + 100)
        self._seen: deque[float] = deque(maxlen=self._average)
        self._phase: _Phase | None = None
        self._op = self._pv = self._sp = math.nan
        self._target = math.nan
        self._away = 0.0
        self._last_op = math.nan
        self._held = 0

    def observe(self, pv: float, op: float) -> None:
        """See `Controller.observe`."""
        require_finite("TwoMove.observe", op=op)
        if self._phase is not None and op != self._last_op:
            self._phase = None  # somebody else has the loop
        self._op, self._pv = op, pv
        if self._phase is None:
            self._before.append(op)

    def decide(self, sp: float) -> Action:
        """See `Controller.decide`."""
        require_finite("TwoMove.decide", sp=sp)
        if math.isnan(self._op):
            return Action(math.nan, ActionStatus.NOT_READY)
        if not math.isfinite(self._pv):
            self._last_op = self._op
            return Action(self._op, ActionStatus.PV_BAD)
        gain = self.model.process.gain
        if self._phase is None:
            self._begin(float(np.mean(self._before)))
        elif sp != self._sp:
            self._begin(self._target + (sp - self._sp) / gain)
        elif self._phase is _Phase.HOLD:
            self._judge(sp, gain)
        self._sp = sp
        op = self._next_op()
        self._last_op = op
        reachable = self._in_reach(self._target) == self._target
        moving = self._phase is not _Phase.HOLD
        status = ActionStatus.MOVING if moving else ActionStatus.HOLDING
        if not reachable:
            status = ActionStatus.LIMITED
        return Action(op, status, self._in_reach(self._target), stem=self._in_reach(self._target))

    def _in_reach(self, position: float) -> float:
        limits, fd = self.settings.limits, self.model.valve.dynamic_friction
        return min(max(position, limits.low + fd), limits.high - fd)

    def _begin(self, target: float) -> None:
        """Plan the two moves to ``target`` from a stem that is somewhere in the band around OP."""
        valve, s = self.model.valve, self.settings
        known = self._phase is _Phase.HOLD
        spread = 0.0 if known else valve.static_friction
        stem = self._in_reach(self._target) if known else self._op
        beyond = valve.slip_jump + s.margin * valve.static_friction
        goal = self._in_reach(target)
        up = max(stem + spread, goal) + beyond + valve.dynamic_friction
        down = min(stem - spread, goal) - beyond - valve.dynamic_friction
        nearer_up = up - self._op <= self._op - down
        upwards = (nearer_up or down < s.limits.low) and up <= s.limits.high
        self._away = up if upwards else max(down, s.limits.low)
        self._target = target
        self._phase = _Phase.AWAY

    def _judge(self, sp: float, gain: float) -> None:
        """Move again if PV, having settled, is elsewhere than at SP by more than noise explains."""
        self._held += 1
        if self._held <= self._settle:
            return
        self._seen.append(self._pv - sp)
        if len(self._seen) < self._average:
            return
        error = float(np.mean(self._seen))
        if abs(error) > self.settings.tolerance * float(np.std(self._seen)):
            self._begin(self._in_reach(self._target) - error / gain)

    def _next_op(self) -> float:
        limits, valve = self.settings.limits, self.model.valve
        if self._phase is _Phase.AWAY:
            op = limits.clip(self._away, self._op)
            if op == self._away:
                self._phase = _Phase.TO_TARGET
            return op
        goal = self._in_reach(self._target)
        if self._phase is _Phase.TO_TARGET:
            side = math.copysign(1.0, self._away - goal)
            wanted = goal - side * valve.dynamic_friction
            op = limits.clip(wanted, self._op)
            if op == wanted:
                self._phase = _Phase.HOLD
                self._held = 0
                self._seen.clear()
            return op
        return limits.clip(goal, self._op)
