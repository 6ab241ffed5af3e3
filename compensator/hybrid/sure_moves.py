"""Moves of the stem that are sure to slip, whatever is still unknown of stem and friction.

A planned move of the process needs a stem move that differs by the error of the gain and, after a
turn, by the error of fD (`StemTracker`). The error of fD shifts where the stem lands, not the OP at
which it slips: a command just inside the estimated band could let the true valve slip while the
filter holds "it stayed". So a move goes as far as is sure to slip under every plausible hypothesis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from compensator.hybrid.moves import LeastMoves
from compensator.hybrid.settings import HybridSettings
from compensator.hybrid.strokes import Strokes
from compensator.stem_tracking.belief import FRICTION, GAIN, Belief
from loop_model import ValveModel

__all__ = ["SureMoves", "plausible_stems"]

_PLAUSIBLE = 0.05
"""Chance from which a hypothesis counts when a move must be sure to slip."""
_LEAST_SHARE = 0.05
"""Share of the least move that is planned at least, however much of it the error of fD takes."""


def plausible_stems(stems: list[float], chances: list[float]) -> tuple[float, ...]:
    """Return the positions that count when a move must be sure to slip."""
    pairs = zip(stems, chances, strict=True)
    return tuple(stem for stem, chance in pairs if chance > _PLAUSIBLE)


@dataclass(frozen=True, slots=True, eq=False)
class SureMoves:
    """Moves from one belief.

    Attributes:
        settings: limits of OP and margins.
        valve: the valve model.
        belief: the hypothesis that is acted upon.
        stems: positions of all plausible hypotheses.
        reach: lowest and highest position that moves can end at.
        op: applied last.
    """

    settings: HybridSettings
    valve: ValveModel
    belief: Belief
    stems: tuple[float, ...]
    reach: tuple[float, float]
    op: float

    @property
    def smallest(self) -> float:
        """Least move: J and a margin; more after a command that did not move the valve."""
        margin = self.settings.slip_margin
        if self.belief.survived > 0.0:
            margin += self.settings.spread * self.belief.survived
        if Strokes.creeps(self.settings, self.valve):
            margin = 0.0  # OP goes on until the stem slips, whatever its friction
        return self.valve.slip_jump + margin * self.valve.static_friction

    @property
    def strokes(self) -> Strokes:
        """What OP does for a move from here."""
        return Strokes(self.settings, self.valve, self.smallest, self.belief.stem, self.op)

    @property
    def gain(self) -> float:
        """Change of the process's drive by one of the stem."""
        return 1.0 + float(self.belief.errors[GAIN])

    def stem_for(self, change: float, direction: float) -> float:
        """Return the stem position that changes the process's drive by ``change``."""
        turned = self.belief.errors[FRICTION] * (direction - self.belief.direction)
        return float(self.belief.stem + (change - turned) / self.gain)

    def change_for(self, position: float, direction: float) -> float:
        """Return the change of the process's drive that a stem position makes."""
        turned = self.belief.errors[FRICTION] * (direction - self.belief.direction)
        return float((position - self.belief.stem) * self.gain + turned)

    def slipping(self, change: float) -> float:
        """Return the stem position for a change of the drive, far enough away to be sure to
        slip.
        """
        side = math.copysign(1.0, change)
        position = self.stem_for(change, side)
        least = self.smallest + self.apart(side)
        return self.belief.stem + side * max(side * (position - self.belief.stem), least)

    def least(self) -> LeastMoves:
        """Return what commands that are sure to slip make of the drive, least of all.

        A slip turns by ``t`` in direction (2 when it reverses), and the error ``w`` of fD makes
        ``w t`` of the drive beside the stem's way.
        """
        wrong, direction = float(self.belief.errors[FRICTION]), self.belief.direction
        on = self.gain * self.smallest
        floor = _LEAST_SHARE * on
        up, down = (on + self.gain * self.apart(side) for side in (1.0, -1.0))
        return LeastMoves(
            up=max(up + wrong * (1.0 - direction), floor),
            down=max(down + wrong * (1.0 + direction), floor),
            on=on,
            back=max(on + 2.0 * wrong, floor),
        )

    def apart(self, side: float) -> float:
        """Return how much farther to ``side`` than the belief the stem may be.

        A move has to go so much farther to be sure to slip, whatever hypothesis holds. After it all
        of them agree, so that a second move need not. Where OP's range or rate does not allow it,
        the move goes as far as they do: what is out of reach must not keep the stem for ever.
        """
        stem, smallest = self.belief.stem, self.smallest
        low, high = self.reach
        room = (high - stem if side > 0.0 else stem - low) - smallest
        room = min(room, self.strokes.ramp().largest - smallest)
        farthest = max((side * (other - stem) for other in self.stems), default=0.0)
        return max(0.0, min(farthest, room))
