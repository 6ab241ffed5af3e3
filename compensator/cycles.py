"""Does an oscillation grow from cycle to cycle?"""

from __future__ import annotations

import math
from collections import deque

__all__ = ["GrowingCycles"]

_GROWTH = 1.15
"""Factor from one cycle's amplitude to the next: noise makes single ones, seldom two in a row."""
_GROWN = 1.6
"""Factor over three cycles."""
_HALF_CYCLES = 6
_BEYOND_NOISE = 1.5
"""Deviations of the noise that the error must be beyond zero for its sign to have changed."""
_LARGE = 5.0
"""Deviations of the noise that the last cycle must have."""


class GrowingCycles:
    """Looks at the peaks of an error between its changes of sign, one `push` a sample.

    Args:
        known: mean square of the error before; a cycle below it, times two, is no growth.
    """

    def __init__(self, known: float) -> None:
        self._known = known
        self._halves: deque[float] = deque(maxlen=_HALF_CYCLES)
        self._side = self._peak = 0.0

    def restart(self) -> None:
        """Forget the cycles seen."""
        self._halves.clear()
        self._side = self._peak = 0.0

    def push(self, error: float, noise_variance: float) -> bool:
        """Take in an error; return whether three cycles have grown."""
        peak, self._peak = self._peak, max(self._peak, abs(error))
        small = abs(error) <= _BEYOND_NOISE * math.sqrt(noise_variance)
        if small or math.copysign(1.0, error) == self._side:
            return False
        began, self._side = self._side != 0.0, math.copysign(1.0, error)
        self._peak = abs(error)
        if not began:
            return False
        self._halves.append(peak)
        return self._grow(noise_variance)

    def _grow(self, noise_variance: float) -> bool:
        halves = list(self._halves)
        if len(halves) < _HALF_CYCLES:
            return False
        cycles = [0.5 * (a + b) for a, b in zip(halves[::2], halves[1::2], strict=True)]
        grows = (
            cycles[1] > _GROWTH * cycles[0]
            and cycles[2] > _GROWTH * cycles[1]
            and cycles[2] > _GROWN * cycles[0]
        )
        least = max(_LARGE * math.sqrt(noise_variance), math.sqrt(2.0 * self._known))
        return grows and cycles[2] > least
