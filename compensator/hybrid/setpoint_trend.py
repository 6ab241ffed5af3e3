"""A set-point that ramps goes on: what is expected of it, and how far ahead it is worth a plan.

A plan that takes the set-point of this scan for the last one corrects an error of a slip jump by a
move there and most of it back, again and again. With the ramp known, one move ahead suffices. And
no error lasts on a ramp: the set-point passes by each position that the stem can take, so that a
plan looks ahead no farther than to the next move, and needs no way back.

A level asks for one other position of the stem for as long as the ramp lasts. What comes after the
ramp asks for the old one: a plan that looks beyond the end that it expects takes the old position
for the better one, and corrects PV by a way there and back again and again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compensator.action import CompensatorError, require_positive, require_whole

__all__ = ["SetpointTrend", "SetpointTrendSettings"]


@dataclass(frozen=True, slots=True)
class SetpointTrendSettings:
    """Settings of `SetpointTrend`.

    Attributes:
        scans: changes of the set-point in a row, of one sign and of like size, that make a ramp;
            where one ends or turns, as many pass before it is known how the set-point goes on.
        alike: factor between the changes of one ramp: a historian's or a register's rounding
            varies them.
        response: settling times of the process that a plan on a ramp looks ahead, beside the dead
            time: half of the answer to a move is over by then.
        steps: least moves of the stem, in scans of the ramp, that it looks ahead beside that.
        seen: share of a level's horizon that its plan on a ramp looks ahead at least; otherwise as
            many scans as the ramp has lasted, which is as long as it is expected to go on.
    """

    scans: int = 4
    alike: float = 2.0
    response: float = 0.5
    steps: float = 0.5
    seen: float = 0.25

    def __post_init__(self) -> None:
        require_whole("SetpointTrendSettings", 1, scans=self.scans)
        require_positive(
            "SetpointTrendSettings", response=self.response, steps=self.steps, seen=self.seen
        )
        if not self.alike >= 1.0:
            raise CompensatorError(
                f"SetpointTrendSettings: alike is a factor of at least 1; got {self.alike!r}"
            )


class SetpointTrend:
    """Notices a ramp of the set-point; `push` once a scan.

    Args:
        longest: scans that a ramp is expected to go on at most.
        settings: what makes a ramp.
    """

    def __init__(self, longest: int, settings: SetpointTrendSettings | None = None) -> None:
        self.settings = settings or SetpointTrendSettings()
        self._longest = longest
        self._last = math.nan
        self._slope = 0.0
        self._run = self._unknown = 0

    def push(self, sp: float) -> None:
        """Take in the set-point of this scan."""
        change, self._last = sp - self._last, sp
        self._unknown = max(0, self._unknown - 1)
        if math.isfinite(change) and change != 0.0 and self._goes_on(change):
            self._run += 1
            self._slope += (change - self._slope) / min(self._run, 2 * self.settings.scans)
        else:
            stepped = abs(change) > self.settings.alike * abs(self._slope)
            if stepped:
                self._unknown = 0
            elif self.is_ramp:
                self._unknown = self.settings.scans
            self._slope = change if math.isfinite(change) else 0.0
            self._run = int(self._slope != 0.0)

    @property
    def is_ramp(self) -> bool:
        """Whether the set-point ramps."""
        return self._run >= self.settings.scans

    @property
    def turns(self) -> bool:
        """Whether a ramp ended or turned just now, so that nothing tells where the set-point goes.

        A plan that takes it for lasting there makes a move back to it, and the next one forth.
        """
        return self._unknown > 0 and not self.is_ramp

    def ahead(self, points: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return how far the set-point is expected to go by ``points`` scans from now.

        A ramp is expected to go on for as long as it has lasted.
        """
        if not self.is_ramp:
            return np.zeros(points.size)
        return self._slope * np.minimum(points, min(self._run, self._longest))

    def lasts(self, horizon: int) -> float:
        """Return the scans that a level's plan on this ramp looks ahead; infinite without a ramp.

        Args:
            horizon: scans that it looks ahead without one.
        """
        if not self.is_ramp:
            return math.inf
        return max(self._run, self.settings.seen * horizon)

    def window(self, dead_time: int, settling: int, step: float) -> float:
        """Return the scans that a plan on this ramp looks ahead; infinite without a ramp.

        Args:
            dead_time, settling: of the process, in scans.
            step: what the stem's least move makes of PV.
        """
        if not self.is_ramp:
            return math.inf
        s = self.settings
        return dead_time + s.response * settling + s.steps * step / abs(self._slope)

    def _goes_on(self, change: float) -> bool:
        if self._slope == 0.0:
            return False
        alike = self.settings.alike
        return 1.0 / alike <= change / self._slope <= alike
