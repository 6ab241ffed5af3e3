"""The knocker: short pulses added to another controller's OP, so that the stem never quite rests.

Hägglund, T. (2002), *A friction compensator for pneumatic control valves*, J. Process Control 12,
897-904. Every ``interval`` scans a pulse of ``width`` scans is added, in the direction in which the
controller has moved OP since the pulse before. Srinivasan, R. and Rengaswamy, R. (2005), *Stiction
compensation in process control loops*, Ind. Eng. Chem. Res. 44, 9164-9174, set the amplitude from
the stick band: half of it, pulses two scans wide, five scans apart. It needs no process model. It
trades PV's oscillation for valve travel, and is here as a peer to measure against.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from compensator.action import (
    Action,
    CompensatorError,
    Controller,
    OpLimits,
    require_finite,
    require_positive,
)
from loop_model import ValveModel

__all__ = ["Knocker", "KnockerSettings"]


@dataclass(frozen=True, slots=True)
class KnockerSettings:
    """Settings of `Knocker`.

    Attributes:
        amplitude: of the pulses, in units of OP.
        width: scans that a pulse lasts.
        interval: scans from the start of one pulse to the next.
        limits: range and rate of OP with the pulses.
    """

    amplitude: float
    width: int = 2
    interval: int = 5
    limits: OpLimits = field(default_factory=OpLimits)

    def __post_init__(self) -> None:
        require_positive("KnockerSettings", amplitude=self.amplitude)
        if not 1 <= self.width <= self.interval:
            raise CompensatorError(
                f"KnockerSettings: a pulse lasts 1 scan up to the interval; got "
                f"width={self.width}, interval={self.interval}"
            )

    @classmethod
    def of(cls, valve: ValveModel, limits: OpLimits | None = None) -> KnockerSettings:
        """Return the settings of Srinivasan and Rengaswamy (2005) for a valve that sticks.

        Raises:
            CompensatorError: the valve has no stick band, there is nothing to knock at.
        """
        return cls(0.5 * valve.stick_band, limits=limits or OpLimits())


class Knocker:
    """Adds the knocker's pulses to ``base``; see the module's text.

    ``base`` goes on from its own OP, without pulses, as the paper draws it.
    """

    def __init__(self, base: Controller, settings: KnockerSettings) -> None:
        self.base = base
        self.settings = settings
        self._count = 0
        self._direction = 0.0
        self._base_op = self._reference = self._op = math.nan

    def observe(self, pv: float, op: float) -> None:
        """See `Controller.observe`."""
        require_finite("Knocker.observe", op=op)
        if op != self._op:  # somebody else has moved OP: begin afresh from there
            self._base_op = self._reference = op
            self._count = 0
            self._direction = 0.0
        self._op = op
        self.base.observe(pv, self._base_op)

    def decide(self, sp: float) -> Action:
        """See `Controller.decide`."""
        action = self.base.decide(sp)
        if not math.isfinite(action.op):
            return action
        s = self.settings
        self._base_op = action.op
        if self._count % s.interval == 0:
            change = action.op - self._reference
            self._direction = math.copysign(1.0, change) if change else 0.0
            self._reference = action.op
        pulse = s.amplitude * self._direction if self._count % s.interval < s.width else 0.0
        self._count += 1
        self._op = s.limits.clip(action.op + pulse, self._op)
        return replace(action, op=self._op, detail=f"pulse {pulse:+.4g}")
