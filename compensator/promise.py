"""Does compensation keep its promise: half of PV's deviation, and no more travel than before?

A loop that is merely no worse than before is not worth another controller. So the figures of a long
stretch are asked for more than the watch asks for at first. What noise alone makes of PV is taken
off: a loop that is held as still as its noise allows has nothing left to gain.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

from compensator.action import require_positive, require_whole

__all__ = ["PromiseSettings", "PromiseWatch"]


@dataclass(frozen=True, slots=True)
class PromiseSettings:
    """Settings of `PromiseWatch`.

    Attributes:
        deviation: share of PV's deviation before that is too much, noise taken off: a tenth above
            the half that is promised, because two stretches of one loop differ by as much.
        travel: factor of the stem's travel before that is too much, with the same tenth.
        strokes: stick bands of travel in the window that are too much for no loop.
        shortest: scans that are averaged at least: four corrections of a slow loop.
        persist: share of the window for which the promise must have been broken.
    """

    deviation: float = 0.55
    travel: float = 1.1
    strokes: float = 4.0
    shortest: int = 240
    persist: float = 0.125

    def __post_init__(self) -> None:
        require_positive(
            "PromiseSettings",
            deviation=self.deviation,
            travel=self.travel,
            strokes=self.strokes,
            persist=self.persist,
        )
        require_whole("PromiseSettings", 1, shortest=self.shortest)


class PromiseWatch:
    """Follows error and travel of settled scans under the compensator; `push` once for each.

    Args:
        mean_square: of the error that is usual.
        travel: of the stem per scan that is usual.
        stroke: way of a correction, a stick band.
        window: scans to average over, if more than the settings' least.
        settings: shares.
    """

    def __init__(
        self,
        mean_square: float,
        travel: float,
        stroke: float,
        window: int,
        settings: PromiseSettings | None = None,
    ) -> None:
        self.settings = s = settings or PromiseSettings()
        length = max(window, s.shortest)
        self._square = s.deviation**2 * mean_square
        self._way = s.travel * travel * length + s.strokes * stroke
        self._lasting = math.ceil(s.persist * length)
        self._squares: deque[float] = deque(maxlen=length)
        self._ways: deque[float] = deque(maxlen=length)
        self._sum_squares = self._sum_ways = 0.0
        self._run = 0

    def push(self, error: float, way: float, noise: float) -> Literal["", "deviation", "travel"]:
        """Take in a scan; return which part of the promise has been broken for too long.

        Args:
            error: PV minus SP.
            way: of the stem, less what the set-point asks for.
            noise: variance that noise alone makes.
        """
        if len(self._squares) == self._squares.maxlen:
            self._sum_squares -= self._squares[0]
            self._sum_ways -= self._ways[0]
        self._squares.append(error**2)
        self._ways.append(way)
        self._sum_squares += error**2
        self._sum_ways += way
        if len(self._squares) < (self._squares.maxlen or 0):
            return ""
        deviates = self._sum_squares / len(self._squares) - noise > self._square
        travels = self._sum_ways > self._way
        self._run = self._run + 1 if deviates or travels else 0
        if self._run < self._lasting:
            return ""
        return "travel" if travels else "deviation"
