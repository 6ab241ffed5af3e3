"""Is the compensated loop better than before? Mean square error and OP travel, window by window."""

from __future__ import annotations

import itertools
from collections import deque
from dataclasses import dataclass
from enum import Enum

__all__ = ["LoopWatch", "WatchVerdict", "WindowFigures"]


class WatchVerdict(Enum):
    """What a `LoopWatch` sees; the value is the explanation for an operator."""

    FINE = "the compensated loop is no worse than before"
    WORSE = "PV deviates more than it did before compensation"
    GROWING = "PV's oscillation grows from window to window"
    HUNTING = "OP travels more than it did before compensation, and PV is no better"


@dataclass(frozen=True, slots=True)
class WindowFigures:
    """Mean square of PV minus SP, and OP travel per sample, of one window."""

    mean_square: float
    travel: float


class LoopWatch:
    """Compares windows of a loop with the figures from before.

    Args:
        window: samples; at least an oscillation's period.
        before: figures under the base controller, or None if it was not watched long enough.
        worse_by: factor of the mean square error above which two windows in a row are too many.
    """

    def __init__(
        self, window: int, before: WindowFigures | None = None, worse_by: float = 1.3
    ) -> None:
        self.window, self.before, self.worse_by = window, before, worse_by
        self._squares = self._travel = 0.0
        self._count = 0
        self._skip = 0
        self._figures: deque[WindowFigures] = deque(maxlen=4)

    def restart(self, skip: int) -> None:
        """Leave out the next ``skip`` samples (a set-point change) and begin a new window."""
        self._squares = self._travel = 0.0
        self._count, self._skip = 0, skip
        self._figures.clear()

    def push(self, error: float, op_change: float, noise_variance: float) -> WatchVerdict:
        """Take in one sample: PV minus SP, the change of OP, and the variance of PV that noise
        alone makes. What twice that variance explains is never held against the compensator.
        """
        if self._skip > 0:
            self._skip -= 1
            return WatchVerdict.FINE
        self._squares += error**2
        self._travel += abs(op_change)
        self._count += 1
        if self._count < self.window:
            return WatchVerdict.FINE
        self._figures.append(WindowFigures(self._squares / self.window, self._travel / self.window))
        self._squares = self._travel = 0.0
        self._count = 0
        if self._figures[-1].mean_square <= 2.0 * noise_variance:
            return WatchVerdict.FINE
        return self._judge()

    def _judge(self) -> WatchVerdict:
        seen = list(self._figures)
        if self.before is not None and len(seen) >= 2:
            limit = self.worse_by * self.before.mean_square
            if min(w.mean_square for w in seen[-2:]) > limit:
                return WatchVerdict.WORSE
            moved = min(w.travel for w in seen[-2:]) > 1.5 * self.before.travel
            if moved and min(w.mean_square for w in seen[-2:]) > 0.5 * self.before.mean_square:
                return WatchVerdict.HUNTING
        grows = len(seen) == 4 and all(
            later.mean_square > 1.5 * earlier.mean_square
            for earlier, later in itertools.pairwise(seen)
        )
        return WatchVerdict.GROWING if grows else WatchVerdict.FINE
