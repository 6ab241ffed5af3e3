"""Is the compensated loop better than before? Judged over periods of the oscillation it replaced.

The mean square error over the last three periods must stay below what the base controller left, and
over the last one and a half far below double that; so a loop that is worse is noticed well within
five periods, the time after a set-point change not counted. Cycles, from one change of the error's
sign to the next but one, show a growing oscillation, whatever was there before; so does an
overshoot as large as the step. Nothing that noise with the stem held explains is held against the
compensator.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

__all__ = ["LoopFigures", "LoopWatch", "WatchVerdict", "oscillation_period"]

_GROWTH = 1.15
_GROWN = 1.6
_HALF_CYCLES = 6
_LONG = 3.0
_SHORT = 1.5
_MUCH_WORSE = 1.8
_AT_REST = 2.0
_SHORTEST_PERIOD = 12
_UNKNOWN_PERIOD = 100.0


class WatchVerdict(Enum):
    """What a `LoopWatch` sees; the value is the explanation for an operator."""

    FINE = "the compensated loop is no worse than before"
    WORSE = "PV deviates more than it did before compensation"
    GROWING = "PV's oscillation grows from cycle to cycle"
    HUNTING = "OP travels more than it did before compensation, and PV is no better"


@dataclass(frozen=True, slots=True)
class LoopFigures:
    """A loop under its base controller.

    Attributes:
        mean_square: of PV minus SP; travel: of OP per sample.
        period: of its oscillation, samples.
    """

    mean_square: float
    travel: float
    period: float


def oscillation_period(errors: Sequence[float], otherwise: float) -> float:
    """Return the mean period of an error, in samples; ``otherwise`` where it has no three turns.

    Its sign has changed once it is half its root mean square beyond zero.
    """
    level = 0.5 * math.sqrt(sum(e * e for e in errors) / max(1, len(errors)))
    side, turns = 0.0, []
    for k, error in enumerate(errors):
        if abs(error) > level and math.copysign(1.0, error) != side:
            if side:
                turns.append(k)
            side = math.copysign(1.0, error)
    if len(turns) < 3:
        return otherwise
    return max(float(_SHORTEST_PERIOD), 2.0 * (turns[-1] - turns[0]) / (len(turns) - 1))


class LoopWatch:
    """Compares a loop with the figures from before, and its cycles with each other.

    Args:
        before: figures under the base controller, or None if it was not watched long enough; then
            only a growing oscillation is noticed.
        worse_by: factor of the mean square error that is too much.
    """

    def __init__(self, before: LoopFigures | None = None, worse_by: float = 1.05) -> None:
        self.before, self.worse_by = before, worse_by
        period = before.period if before is not None else _UNKNOWN_PERIOD
        self._long, self._short = math.ceil(_LONG * period), math.ceil(_SHORT * period)
        self._squares: deque[float] = deque(maxlen=self._long)
        self._travels: deque[float] = deque(maxlen=self._long)
        self._quietest = math.inf
        self._halves: deque[float] = deque(maxlen=_HALF_CYCLES)
        self._side = self._peak = 0.0
        self._skip = self._patience = 0
        self._from = 0.0

    def restart(self, skip: int) -> None:
        """Leave out the next ``skip`` samples (a set-point change), at most one and a half periods,
        and as many again while the error has not changed its sign; what was seen before counts.
        """
        skip = min(skip, self._short)
        self._skip = self._patience = skip
        self._from = 0.0
        self._halves.clear()
        self._side = self._peak = 0.0

    def push(self, error: float, op_change: float, noise_variance: float) -> WatchVerdict:
        """Take in one sample: PV minus SP, the change of OP, and the variance of PV that noise
        alone makes with the stem held.
        """
        self._quietest = min(self._quietest, noise_variance)
        if self._overshoots(error):
            return WatchVerdict.GROWING
        if self._still_settling(error):
            return WatchVerdict.FINE
        self._squares.append(error**2)
        self._travels.append(abs(op_change))
        verdict = self._push_cycle(error, noise_variance)
        return verdict if verdict is not WatchVerdict.FINE else self._judge()

    def _overshoots(self, error: float) -> bool:
        """Whether PV went as far beyond SP as it was away from it, and far beyond all before."""
        known = 0.0 if self.before is None else self.before.mean_square
        usual = max(4.0 * math.sqrt(known), 8.0 * math.sqrt(self._quietest), abs(self._from))
        return error * self._from < 0.0 and abs(error) > usual

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

    def _judge(self) -> WatchVerdict:
        if self.before is None or len(self._squares) < self._short:
            return WatchVerdict.FINE
        known, squares, travels = self.before.mean_square, list(self._squares), list(self._travels)
        recent = sum(squares[-self._short :]) / self._short
        room = self._room(sum(travels[-self._short :]) / self._short)
        if recent > max(_MUCH_WORSE * room * known, 2.0 * self._quietest):
            return WatchVerdict.WORSE
        if len(squares) < self._long:
            return WatchVerdict.FINE
        mean_square, travel = sum(squares) / self._long, sum(travels) / self._long
        if mean_square > max(self.worse_by * self._room(travel) * known, 1.1 * self._quietest):
            return WatchVerdict.WORSE
        much = 1.5 * self.before.travel
        if travel > much and mean_square > max(0.5 * known, 2.0 * self._quietest):
            return WatchVerdict.HUNTING
        return WatchVerdict.FINE

    def _room(self, travel: float) -> float:
        """Return a factor for the mean square allowed: a valve at rest makes no oscillation, what
        PV does then is noise, or a load about to be compensated.
        """
        assert self.before is not None
        return _AT_REST if travel < 0.1 * self.before.travel else 1.0

    def _push_cycle(self, error: float, noise_variance: float) -> WatchVerdict:
        peak, self._peak = self._peak, max(self._peak, abs(error))
        # The sign has changed once the error is beyond the noise on the other side.
        if abs(error) <= 1.5 * math.sqrt(noise_variance) or math.copysign(1.0, error) == self._side:
            return WatchVerdict.FINE
        began, self._side = self._side != 0.0, math.copysign(1.0, error)
        self._peak = abs(error)
        if not began:
            return WatchVerdict.FINE
        self._halves.append(peak)
        return self._judge_cycles(noise_variance)

    def _judge_cycles(self, noise_variance: float) -> WatchVerdict:
        halves = list(self._halves)
        if len(halves) < _HALF_CYCLES:
            return WatchVerdict.FINE
        cycles = [0.5 * (a + b) for a, b in zip(halves[::2], halves[1::2], strict=True)]
        grows = (
            cycles[1] > _GROWTH * cycles[0]
            and cycles[2] > _GROWTH * cycles[1]
            and cycles[2] > _GROWN * cycles[0]
        )
        known = 0.0 if self.before is None else self.before.mean_square
        if grows and cycles[2] > max(5.0 * math.sqrt(noise_variance), math.sqrt(2.0 * known)):
            return WatchVerdict.GROWING
        return WatchVerdict.FINE
