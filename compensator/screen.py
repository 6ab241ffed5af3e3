"""Is PV alive? NaN is bad at once; the very same number again and again is a frozen sensor."""

from __future__ import annotations

import itertools
import math
from collections import deque

__all__ = ["PvScreen"]

_CHANGES, _TURNS = 20, 4
"""Latest changes of PV that are looked at, and how often their sign must turn in them for noise: a
random walk turns 9.5 times on average and fewer than 4 times in one of 500 cases; an oscillation of
14 samples or more, which is the loop's own, turns 3 times at most.
"""


class PvScreen:
    """Turns a frozen PV into NaN.

    A signal with noise does not repeat to the last digit for long. How long is long is learnt: a
    coarsely quantised PV repeats by nature, so four times its longest repetition so far is needed,
    and at least ``limit`` scans. A loop without noise may come to rest; it is never called frozen.
    Its PV comes to rest along a curve, whereas noise turns back every second or third scan: the
    changes before the repetition tell the two apart.

    Args:
        limit: least scans of the same value that count as frozen.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._last = math.nan
        self._run = 0
        self._longest = 0
        self._noisy = False
        self._rose: deque[bool] = deque(maxlen=_CHANGES)

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
                self._rose.append(pv > self._last)
        if self._run <= 1:
            turns = sum(a != b for a, b in itertools.pairwise(self._rose))
            self._noisy = noise_std > 1e-5 * scale and turns >= _TURNS
        self._last = pv
        return math.nan if self.frozen else pv
