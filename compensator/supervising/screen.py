"""Is PV alive? NaN is bad at once; the very same number again and again is a frozen sensor."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Iterable

__all__ = ["PvScreen"]

_VALUES, _TURNS = 22, 4
"""Latest values of PV that are looked at, and how often their changes must turn for noise: those of
a random walk turn 9.5 times on average, and fewer than 4 times in one of 500 cases; those of an
oscillation of 14 samples or more, which is the loop's own, turn 3 times at most.
"""
_ROUNDED = (0.0, 4.0, 8.0)
"""Quanta of PV up to which a change, a change of changes, and a change of those count for nothing:
twice what rounding makes of a smooth curve.
"""


class PvScreen:
    """Turns a frozen PV into NaN.

    A signal with noise does not repeat to the last digit for long. How long is long is learnt: a
    coarsely quantised PV repeats by nature, so four times its longest repetition so far is needed,
    and at least ``limit`` scans. A loop without noise may come to rest; it is never called frozen.
    Its PV comes to rest along a smooth curve, whereas noise turns every second or third scan: the
    values before the repetition tell the two apart.

    Args:
        limit: least scans of the same value that count as frozen.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._last = math.nan
        self._run = 0
        self._longest = 0
        self._noisy = False
        self._quantum = math.inf
        self._latest: deque[float] = deque(maxlen=_VALUES)

    @property
    def frozen(self) -> bool:
        """Whether PV has stood still for too long."""
        return self._noisy and self._run >= max(self.limit, 4 * self._longest)

    def check(self, pv: float, noise_std: float, scale: float) -> float:
        """Return PV of this scan, NaN when it is bad or frozen.

        Args:
            pv: as measured.
            noise_std: deviation of the noise that PV is known to have; 0 while unknown.
            scale: PV that OP moves, the size that noise is compared with.
        """
        if pv == self._last:
            self._run += 1
        else:
            if not self.frozen:
                self._longest = max(self._longest, self._run)
            self._run = 0
            if math.isfinite(pv - self._last):
                self._quantum = min(self._quantum, abs(pv - self._last))
        if self._run == 1:
            rough = _is_rough(self._latest, self._quantum)
            self._noisy = noise_std > 1e-5 * scale and rough
        if math.isfinite(pv):
            self._latest.append(pv)
        self._last = pv
        return math.nan if self.frozen else pv


def _is_rough(values: Iterable[float], quantum: float) -> bool:
    """Whether values turn as often as noise does, or their slope, or the change of their slope: a
    process of second order smooths what passes through it twice.
    """
    signal = list(values)
    for quanta in _ROUNDED:
        signal = [b - a for a, b in itertools.pairwise(signal)]
        rose = [value > 0.0 for value in signal if value and abs(value) > quanta * quantum]
        if sum(a != b for a, b in itertools.pairwise(rose)) >= _TURNS:
            return True
    return False
