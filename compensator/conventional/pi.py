"""A PI controller in velocity form: what most loops run."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from compensator.action import (
    Action,
    ActionStatus,
    OpLimits,
    require_finite,
    require_positive,
)
from compensator.prediction import Prediction, settling_samples
from loop_model import ProcessModel

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

    @classmethod
    def simc(cls, process: ProcessModel, limits: OpLimits | None = None) -> PiSettings:
        """Return SIMC settings (Skogestad, 2003, J. Process Control 13, 291-309) for a process.

        The step response's 28.3 and 63.2 % give lag and delay (of an integrating process its
        asymptote gives slope and delay); the closed loop's time constant is the delay, and no
        shorter than three scans (ten when integrating), because PV has noise.
        """
        prediction = Prediction.of(process)
        response = prediction.step_response(settling_samples(prediction) + 5)
        if process.is_integrating:
            slope = float(response[-1] - response[-2])
            delay = response.size - float(response[-1]) / slope
            closed = max(delay, 10.0)
            gain = 1.0 / (slope * (closed + delay))
            reset = 4.0 * (closed + delay)
        else:
            share = response / process.gain
            early, late = (float(np.argmax(share >= level)) + 1.0 for level in (0.283, 0.632))
            lag = max(1.5 * (late - early), 1.0)
            delay = max(late - lag, 1.0)
            closed = max(delay, 3.0)
            gain = lag / (process.gain * (closed + delay))
            reset = min(lag, 4.0 * (closed + delay))
        return cls(gain, reset * process.period, process.period, limits or OpLimits())


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
