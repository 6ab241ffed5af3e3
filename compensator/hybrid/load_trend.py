"""A load that drifts goes on: what is expected of it, and for how long a correction is worth it.

A plan that takes the load of this scan for the last one corrects an error below a slip jump by a
move there and most of it back. While the load drifts, PV is off again before that has paid. With
the drift known, one move ahead of it suffices, and no way back is needed: the load passes by each
position that the stem can take, as a set-point that ramps does (`SetpointTrend`).

Example: a load that drifts by 0.05 OP a scan, a slip jump of 2. The stem has to make a jump every
40 scans; without the drift known it made two of them, and one more, in that time.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compensator.action import CompensatorError, require_positive, require_whole

__all__ = ["LoadTrend", "LoadTrendSettings"]


@dataclass(frozen=True, slots=True)
class LoadTrendSettings:
    """Settings of `LoadTrend`.

    Attributes:
        span: settling times of the process, beside the dead time, over which a drift is looked for:
            the tracker needs as long to see the load.
        shortest: scans of that at least: fewer hold one or two independent values of the load.
        parts: parts of the span in each of which the load must have drifted, so that a step, which
            the tracker rounds off, is no drift.
        alike: factor between the drift in a part and that in the whole span.
        least: least moves of the stem by which the load must have drifted in the span.
        doubts: deviations of what is believed of the load by which it must have drifted.
        response: settling times that a plan looks ahead, beside the dead time, as on a ramp of
            the set-point; steps: least moves of the stem, in scans of the drift, beside that.
    """

    span: float = 1.0
    shortest: int = 40
    parts: int = 3
    alike: float = 3.0
    least: float = 0.5
    doubts: float = 2.0
    response: float = 0.5
    steps: float = 0.5

    def __post_init__(self) -> None:
        require_positive(
            "LoadTrendSettings",
            span=self.span,
            shortest=self.shortest,
            least=self.least,
            doubts=self.doubts,
            response=self.response,
            steps=self.steps,
        )
        require_whole("LoadTrendSettings", 1, parts=self.parts)
        if not self.alike >= 1.0:
            raise CompensatorError(
                f"LoadTrendSettings: alike is a factor of at least 1; got {self.alike!r}"
            )


class LoadTrend:
    """Notices a drift of the load; `push` once a scan.

    Args:
        dead_time, settling: of the process, in scans.
        settings: what makes a drift.

    Attributes:
        slope: OP a scan by which the stem's balance position drifts; 0 without a drift.
    """

    def __init__(
        self, dead_time: int, settling: int, settings: LoadTrendSettings | None = None
    ) -> None:
        self.settings = s = settings or LoadTrendSettings()
        self._dead_time, self._settling = dead_time, settling
        span = max(s.shortest, dead_time + math.ceil(s.span * settling))
        self._balances: deque[float] = deque(maxlen=span)
        part = span // s.parts
        self._whole = _slope_weights(span)
        self._part, self._starts = _slope_weights(part), [i * part for i in range(s.parts)]
        self._source: object = None
        self.slope = 0.0

    def push(self, balance: float, doubt: float, least: float, source: object) -> None:
        """Take in a scan.

        Args:
            balance: position of the stem at which the load is balanced, in OP.
            doubt: deviation of what is believed of it.
            least: least move of the stem.
            source: who believes it; another one goes on from its own level.
        """
        if self._balances and source is not self._source:
            shift = balance - self._balances[-1]
            self._balances = deque((b + shift for b in self._balances), self._balances.maxlen)
        self._source = source
        self._balances.append(balance)
        self.slope = 0.0
        if len(self._balances) < self._whole.size:
            return
        s, values = self.settings, np.array(self._balances)
        slope = float(self._whole @ values)
        way = abs(slope) * values.size
        if way < s.least * least or way < s.doubts * doubt:
            return
        parts = [values[start : start + self._part.size] for start in self._starts]
        shares = [float(self._part @ part) / slope for part in parts]
        if all(1.0 / s.alike <= share <= s.alike for share in shares):
            self.slope = slope

    @property
    def drifts(self) -> bool:
        """Whether the load drifts."""
        return self.slope != 0.0

    def ahead(self, ramp_response: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the drift will make of PV with the stem at rest.

        Args:
            ramp_response: of PV to a drive that grows by 1 OP a scan from now on, by scan.
        """
        return -self.slope * ramp_response

    def window(self, least: float) -> float:
        """Return the scans that a plan looks ahead; infinite without a drift.

        Args:
            least: least move of the stem.
        """
        if not self.drifts:
            return math.inf
        s = self.settings
        return self._dead_time + s.response * self._settling + s.steps * least / abs(self.slope)

    def lasts(self, walk: float) -> float:
        """Return the scans for which a correction of a load that walks lasts.

        Args:
            walk: least moves that the load goes in a settling time, as the deviation of a random
                walk; 0 where it rests.
        """
        if walk == 0.0:
            return math.inf
        s = self.settings
        walks = (s.steps / walk) ** 2 * self._settling
        return self._dead_time + s.response * self._settling + walks


def _slope_weights(count: int) -> NDArray[np.float64]:
    """Return the weights whose sum with so many values is the slope of the line through them."""
    times = np.arange(count) - 0.5 * (count - 1)
    return np.asarray(times / float(times @ times), dtype=np.float64)
