"""A PI controller in velocity form: what most loops run."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from compensator.action import (
    Action,
    ActionStatus,
    OpLimits,
    require_finite,
    require_positive,
)

__all__ = ["PiController", "PiSettings"]


@dataclass(frozen=True, slots=True)
class PiSettings:
    """Settings of `PiController`.

    Attributes:
        gain: OP per PV, of any sign but zero. Positive acts in reverse (PV above SP lowers OP, for
            a process of positive gain), negative acts directly.
        integral_time: seconds.
        period: seconds between scans.
        limits: range and rate of OP.
    """

    gain: float
    integral_time: float
    period: float = 1.0
    limits: OpLimits = field(default_factory=OpLimits)

    def __post_init__(self) -> None:
        require_positive(
            "PiSettings",
            abs_gain=abs(self.gain),
            integral_time=self.integral_time,
            period=self.period,
        )


class PiController:
    """PI in velocity form: ``dOP = gain * (de + e * period / integral_time)``, ``e = SP - PV``.

    It adds to the OP that was *applied*: nothing winds up at a limit, and a take-over from manual
    or from another controller starts from the OP that it finds. A step of SP enters both terms.
    """

    def __init__(self, settings: PiSettings) -> None:
        self.settings = settings
        self._pv = math.nan
        self._op = math.nan
        self._error = math.nan
        self._decided = False

    def observe(self, pv: float, op: float) -> None:
        """See `Controller.observe`."""
        require_finite("PiController.observe", op=op)
        if not self._decided:  # somebody else had the loop: the proportional part starts afresh
            self._error = math.nan
        self._decided = False
        self._pv, self._op = pv, op

    def decide(self, sp: float) -> Action:
        """See `Controller.decide`."""
        require_finite("PiController.decide", sp=sp)
        if math.isnan(self._op):
            return Action(math.nan, ActionStatus.NOT_READY)
        if not math.isfinite(self._pv):
            return Action(self._op, ActionStatus.PV_BAD)
        s = self.settings
        error = sp - self._pv
        change = 0.0 if math.isnan(self._error) else error - self._error
        self._error, self._decided = error, True
        wanted = self._op + s.gain * (change + error * s.period / s.integral_time)
        op = s.limits.clip(wanted, self._op)
        at_range = wanted < s.limits.low or wanted > s.limits.high
        return Action(op, ActionStatus.LIMITED if at_range else ActionStatus.OPTIMAL)
