"""From positions of the stem to OP: what moves it there, holds it, and how long a slow OP takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from compensator.hybrid.moves import Ramp
from compensator.hybrid.settings import HybridSettings
from loop_model import ValveModel

__all__ = ["Strokes"]


@dataclass(frozen=True, slots=True)
class Strokes:
    """OP for a stem that is believed at ``stem``, with ``op`` applied last.

    Attributes:
        settings: limits of OP and margins.
        valve: the valve model.
        smallest: least move of the stem that is sure to slip.
        stem: position believed.
        op: applied last.
    """

    settings: HybridSettings
    valve: ValveModel
    smallest: float
    stem: float
    op: float

    @staticmethod
    def creeps(settings: HybridSettings, valve: ValveModel) -> bool:
        """Whether OP's rate limit is too low for moves of a chosen size: in one scan OP cannot
        cross the uncertainty of the static friction, or only sizes near the least are possible.
        """
        leap = settings.edge * valve.static_friction + settings.limits.rate - valve.dynamic_friction
        least = valve.slip_jump + settings.slip_margin * valve.static_friction
        return leap < settings.room * least

    def ramp(self) -> Ramp:
        """Return what OP's rate limit means for moves from here: OP has to travel to the edge of
        the band first, a slip begins from there with one scan's worth of rate, and after it OP
        stands fD away from the stem.
        """
        rate, valve, smallest = self.settings.limits.rate, self.valve, self.smallest
        dwell = max(1, self.settings.dwell)
        if math.isinf(rate):
            return Ramp(opposite=dwell)
        fd, lead = valve.dynamic_friction, self.op - self.stem

        def scans(way: float) -> int:
            return max(0, math.ceil(min(way / rate, 1e6) - 1e-9))

        leap = self.settings.edge * valve.static_friction + rate - fd
        return Ramp(
            up=max(0, scans(smallest + fd - lead) - 1),
            down=max(0, scans(smallest + fd + lead) - 1),
            same=max(1, scans(smallest)),
            opposite=max(dwell, scans(smallest + 2.0 * fd)),
            largest=smallest + rate if self.creeps(self.settings, valve) else leap,
        )

    def move(self, position: float) -> float:
        """Return the OP that moves the stem to ``position``, as far as the rate limit lets it."""
        valve, limits = self.valve, self.settings.limits
        side = math.copysign(1.0, position - self.stem)
        wanted = position + side * valve.dynamic_friction
        op = limits.clip(wanted, self.op)
        if self.creeps(self.settings, valve):
            # From here one scan's worth of rate slips, and lands where it should.
            ahead = min((wanted - self.stem) * side - limits.rate, 0.97 * valve.static_friction)
            way = ahead - (self.op - self.stem) * side
            step = way if 0.1 * limits.rate < way < limits.rate else limits.rate
            return limits.clip(self.op + side * step, self.op)
        edge = self.stem + side * self.settings.edge * valve.static_friction
        slips_early = op != wanted and (op - edge) * side > 0.0
        if slips_early and (self.op - edge) * side < -1e-9:
            # Too slow to do it in one go: wait at the band's edge, then jump from there.
            return limits.clip(edge, self.op)
        return op

    def dwell(self) -> float:
        """Return the OP that lets a slow stem arrive: the present one, if it stays in the band."""
        reach = self.settings.edge * self.valve.static_friction
        low, high = self.stem - reach, self.stem + reach
        return self.settings.limits.clip(min(max(self.op, low), high), self.op)

    def hold(self) -> float:
        """Return the middle of the band, the OP that no disturbance turns into a slip."""
        return self.settings.limits.clip(self.stem, self.op)
