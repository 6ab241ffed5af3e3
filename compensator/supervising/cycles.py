"""Does an oscillation grow from cycle to cycle?"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from compensator.action import require_not_negative, require_positive

__all__ = ["CycleSettings", "GrowingCycles"]

_HALF_CYCLES = 6
"""Half cycles that three cycles are made of."""


@dataclass(frozen=True, slots=True)
class CycleSettings:
    """Settings of `GrowingCycles`.

    Attributes:
        growth: factor from one cycle's amplitude to the next: noise makes single ones, seldom two
            in a row.
        grown: factor over three cycles.
        beyond_noise: deviations of the noise that the error must be beyond zero for its sign to
            have changed.
        large: deviations of the noise that the last cycle must have.
    """

    growth: float = 1.15
    grown: float = 1.6
    beyond_noise: float = 1.5
    large: float = 5.0

    def __post_init__(self) -> None:
        require_positive(
            "CycleSettings", growth=self.growth, grown=self.grown, beyond_noise=self.beyond_noise
        )
        require_not_negative("CycleSettings", large=self.large)


class GrowingCycles:
    """Looks at the peaks of an error between its changes of sign, one `push` a sample.

    Args:
        known: mean square of the error before; a cycle below it, times two, is no growth.
        settings: factors.
    """

    def __init__(self, known: float, settings: CycleSettings | None = None) -> None:
        self._known, self.settings = known, settings or CycleSettings()
        self._halves: deque[float] = deque(maxlen=_HALF_CYCLES)
        self._side = self._peak = 0.0

    def restart(self) -> None:
        """Forget the cycles seen."""
        self._halves.clear()
        self._side = self._peak = 0.0

    def push(self, error: float, noise_variance: float) -> bool:
        """Take in an error; return whether three cycles have grown."""
        peak, self._peak = self._peak, max(self._peak, abs(error))
        small = abs(error) <= self.settings.beyond_noise * math.sqrt(noise_variance)
        if small or math.copysign(1.0, error) == self._side:
            return False
        began, self._side = self._side != 0.0, math.copysign(1.0, error)
        self._peak = abs(error)
        if not began:
            return False
        self._halves.append(peak)
        return self._grow(noise_variance)

    def _grow(self, noise_variance: float) -> bool:
        s, halves = self.settings, list(self._halves)
        if len(halves) < _HALF_CYCLES:
            return False
        cycles = [0.5 * (a + b) for a, b in zip(halves[::2], halves[1::2], strict=True)]
        grows = (
            cycles[1] > s.growth * cycles[0]
            and cycles[2] > s.growth * cycles[1]
            and cycles[2] > s.grown * cycles[0]
        )
        least = max(s.large * math.sqrt(noise_variance), math.sqrt(2.0 * self._known))
        return grows and cycles[2] > least
