"""The PI controller that a map may put between two tags of an FMU."""

from __future__ import annotations

from compensator import OpLimits, PiController, PiSettings
from fieldlink.lab.fmu.mapping import ControllerMap

__all__ = ["LoopController"]


class LoopController:
    """A PI in the units of its tags.

    Args:
        settings: of the map.
        period: seconds between two decisions.
        op: OP that the plant starts with.
    """

    def __init__(self, settings: ControllerMap, period: float, op: float) -> None:
        self.op_tag, self.pv_tag = settings.op, settings.pv
        limits = OpLimits(settings.low, settings.high)
        self._pi = PiController(PiSettings(settings.gain, settings.integral_time, period, limits))
        self.op = min(max(op, settings.low), settings.high)

    def decide(self, pv: float, sp: float) -> float:
        """Return the OP for a PV and a set-point."""
        self._pi.observe(pv, self.op)
        self.op = self._pi.decide(sp).op
        return self.op
