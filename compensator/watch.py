"""Is the compensated loop better than before? Judged by windows and by cycles of the oscillation.

A window's mean square error and OP travel show a loop that is worse, or that hunts. Cycles, from
one change of the error's sign to the next but one, show a growing oscillation within three
periods, whatever the window; one that stays below what was there before is no reason. Nothing that
noise explains is held against the compensator.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum

__all__ = ["LoopWatch", "WatchVerdict", "WindowFigures"]

_GROWTH = 1.15
_GROWN = 1.6
_HALF_CYCLES = 6


class WatchVerdict(Enum):
    """What a `LoopWatch` sees; the value is the explanation for an operator."""

    FINE = "the compensated loop is no worse than before"
    WORSE = "PV deviates more than it did before compensation"
    GROWING = "PV's oscillation grows from cycle to cycle"
    HUNTING = "OP travels more than it did before compensation, and PV is no better"


@dataclass(frozen=True, slots=True)
class WindowFigures:
    """Mean square of PV minus SP, and OP travel per sample, of one window."""

    mean_square: float
    travel: float


@dataclass(slots=True)
class _HalfCycle:
    """The error between two changes of its sign."""

    peak: float = 0.0
    squares: float = 0.0
    samples: int = 0


class LoopWatch:
    """Compares a loop with the figures from before, and its cycles with each other.

    Args:
        window: samples; at least an oscillation's period.
        before: figures under the base controller, or None if it was not watched long enough.
        worse_by: factor of the mean square error above which two windows, or three cycles, in a
            row are too many.
    """

    def __init__(
        self, window: int, before: WindowFigures | None = None, worse_by: float = 1.3
    ) -> None:
        self.window, self.before, self.worse_by = window, before, worse_by
        self._figures: deque[WindowFigures] = deque(maxlen=2)
        self._halves: deque[_HalfCycle] = deque(maxlen=_HALF_CYCLES)
        self.restart(0)

    def restart(self, skip: int) -> None:
        """Begin anew: leave out the next ``skip`` samples (a set-point change), and more until the
        error has changed its sign, at most three times as many.
        """
        self._squares = self._travel = 0.0
        self._count, self._skip = 0, skip
        self._patience = 2 * skip
        self._from = 0.0
        self._figures.clear()
        self._halves.clear()
        self._half = _HalfCycle()
        self._side = 0.0

    def push(self, error: float, op_change: float, noise_variance: float) -> WatchVerdict:
        """Take in one sample: PV minus SP, the change of OP, and the variance of PV that noise
        alone makes. What twice that variance explains is never held against the compensator.
        """
        if self._still_settling(error):
            return WatchVerdict.FINE
        verdict = self._push_cycle(error, noise_variance)
        self._squares += error**2
        self._travel += abs(op_change)
        self._count += 1
        if self._count < self.window or verdict is not WatchVerdict.FINE:
            return verdict
        self._figures.append(WindowFigures(self._squares / self.window, self._travel / self.window))
        self._squares = self._travel = 0.0
        self._count = 0
        if self._figures[-1].mean_square <= 2.0 * noise_variance:
            return WatchVerdict.FINE
        return self._judge_windows()

    def _still_settling(self, error: float) -> bool:
        if self._from == 0.0:
            self._from = error
        if self._skip > 0:
            self._skip -= 1
            return True
        if self._patience > 0 and error * self._from > 0.0:
            self._patience -= 1
            return True
        self._patience = 0
        return False

    def _push_cycle(self, error: float, noise_variance: float) -> WatchVerdict:
        half = self._half
        half.peak = max(half.peak, abs(error))
        half.squares += error**2
        half.samples += 1
        # The sign has changed once the error is beyond the noise on the other side.
        if abs(error) <= 1.5 * math.sqrt(noise_variance) or math.copysign(1.0, error) == self._side:
            return WatchVerdict.FINE
        began, self._side = self._side != 0.0, math.copysign(1.0, error)
        self._half = _HalfCycle()
        if not began:
            return WatchVerdict.FINE
        self._halves.append(half)
        return self._judge_cycles(noise_variance)

    def _judge_cycles(self, noise_variance: float) -> WatchVerdict:
        halves = list(self._halves)
        if len(halves) < _HALF_CYCLES:
            return WatchVerdict.FINE
        cycles = [0.5 * (a.peak + b.peak) for a, b in zip(halves[::2], halves[1::2], strict=True)]
        grows = (
            cycles[1] > _GROWTH * cycles[0]
            and cycles[2] > _GROWTH * cycles[1]
            and cycles[2] > _GROWN * cycles[0]
        )
        known = 0.0 if self.before is None else self.before.mean_square
        if grows and cycles[2] > max(5.0 * math.sqrt(noise_variance), math.sqrt(2.0 * known)):
            return WatchVerdict.GROWING
        mean_square = sum(h.squares for h in halves) / sum(h.samples for h in halves)
        if self.before is not None and mean_square > max(
            self.worse_by * self.before.mean_square, 2.0 * noise_variance
        ):
            return WatchVerdict.WORSE
        return WatchVerdict.FINE

    def _judge_windows(self) -> WatchVerdict:
        if self.before is None or len(self._figures) < 2:
            return WatchVerdict.FINE
        least = min(w.mean_square for w in self._figures)
        if least > self.worse_by * self.before.mean_square:
            return WatchVerdict.WORSE
        moved = min(w.travel for w in self._figures) > 1.5 * self.before.travel
        if moved and least > 0.5 * self.before.mean_square:
            return WatchVerdict.HUNTING
        return WatchVerdict.FINE
