"""Is the compensated loop better than before? Judged over periods of the oscillation it replaced.

Five questions, from the quickest to the slowest:

* does PV run away: is the error far beyond all that was known, or OP at a limit with PV leaving,
  for longer than the dead time explains (`RunAway`)?
* does it overshoot a set-point step by as much as the step, or grow from cycle to cycle?
* is PV worse **and** the stem's travel more than before (`HarmWatch`)?
* is PV worse, or travel over its budget, over periods enough for the figures to be fair, or so much
  that they will be, however good the loop is from now on?
* is the promise kept: half of PV's deviation and no more travel than before (`PromiseWatch`)?

Nothing that noise with the stem held explains is held against the compensator; nor is a set-point
that OP's range cannot reach, or the travel that a moving set-point asks for.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum

from compensator.supervising.cycles import GrowingCycles
from compensator.supervising.figures import LoopFigures
from compensator.supervising.harm import HarmWatch
from compensator.supervising.promise import PromiseWatch
from compensator.supervising.setpoint_way import SetpointWay
from compensator.supervising.watch_settings import WatchSettings

__all__ = ["LoopWatch", "RunAway", "WatchVerdict", "Watched"]


class WatchVerdict(Enum):
    """What a `LoopWatch` sees; the value is the explanation for an operator."""

    FINE = "the compensated loop is no worse than before"
    WORSE = "PV deviates more than it did before compensation"
    GROWING = "PV's oscillation grows from cycle to cycle"
    HUNTING = "the stem travels more than it did before compensation, and PV is no better"
    TRAVEL = "the stem travels more than its budget allows"
    NO_GAIN = "PV still deviates more than half as much as it did before compensation"
    WRONG_SIGN = "PV answers to OP against the sign of the model's gain"
    LEFT_RANGE = "PV left the range that was known of it and did not return"


@dataclass(frozen=True, slots=True)
class Watched:
    """One scan of a compensated loop.

    Attributes:
        error: PV minus SP.
        travel: way of the stem, by the valve model.
        noise_variance: variance of PV that noise alone makes with the stem held.
        sp_travel: OP that the change of SP in this scan asks for.
        sp_change: change of SP in this scan.
        limited: whether the set-point is out of OP's reach.
        at_limit: whether OP stands at an end of its range.
        stem: where it is, by the valve model; NaN if not known.
    """

    error: float
    travel: float
    noise_variance: float
    sp_travel: float = 0.0
    sp_change: float = 0.0
    limited: bool = False
    at_limit: bool = False
    stem: float = math.nan


class RunAway:
    """Notices an error far beyond all that was known that does not return.

    Args:
        largest: error known.
        dead_time: samples from OP to PV.
        settings: of the watch.
    """

    def __init__(self, largest: float, dead_time: int, settings: WatchSettings) -> None:
        self._largest, self._settings = largest, settings
        scans = min(dead_time + settings.trip_scans, settings.trip_latest)
        self._latest = min(2 * scans, settings.trip_latest)
        self._beyond: deque[float] = deque(maxlen=scans)
        self._at_limit: deque[float] = deque(maxlen=scans)
        self._often = 0.0

    def push(self, seen: Watched, noise: float, expected: float) -> bool:
        """Take in a scan; return whether PV runs away.

        Args:
            seen: the scan.
            noise: deviation that noise alone makes.
            expected: size of error that a set-point change explains, 0 without one.
        """
        # The largest error of a record is noise's too: more than twice that it cannot be.
        known = max(self._largest, min(4.0 * noise, 2.0 * self._largest))
        size = abs(seen.error)
        far = size > self._settings.pv_trip * known + expected
        pushed = seen.at_limit and size > self._settings.limit_trip * known + expected
        # An oscillation that runs away returns for a while each half period.
        self._often = max(0.0, self._often + (1.0 if far else -0.5))
        if self._often >= self._latest:
            return True
        return _stays(self._beyond, size, far, 1.0) or _stays(self._at_limit, size, pushed, 1.02)


def _stays(sizes: deque[float], size: float, beyond: bool, factor: float) -> bool:
    """Return whether errors beyond have filled their window without becoming smaller."""
    if not beyond:
        sizes.clear()
        return False
    sizes.append(size)
    if len(sizes) < (sizes.maxlen or 0):
        return False
    seen, half = list(sizes), len(sizes) // 2
    return math.fsum(seen[half:]) / (len(seen) - half) >= factor * math.fsum(seen[:half]) / half


class LoopWatch:
    """Compares a compensated loop with the figures from before, and its cycles with each other.

    Args:
        before: figures under the base controller.
        settings: factors and windows.
        horizon: samples that the compensator plans ahead; no verdict of the windows before.
        dead_time: samples from OP to PV.
        stroke: way that a correction takes (a stick band); what two of them travel in the long
            window is over no budget.
        step: what a slip jump makes of PV; no controller sets PV finer without going to and fro.
    """

    def __init__(
        self,
        before: LoopFigures,
        settings: WatchSettings | None = None,
        *,
        horizon: int = 0,
        dead_time: int = 1,
        stroke: float = 0.0,
        step: float = 0.0,
    ) -> None:
        self.before, self.settings = before, settings or WatchSettings()
        quick, short, long = self.settings.periods
        period = before.period
        self._quick = math.ceil(max(quick * period, self.settings.least))
        self._short = math.ceil(max(short * period, min(horizon, 4.0 * period), self._quick))
        self._long = math.ceil(max(long * period, 1.8 * self._short))
        self._lasting = math.ceil(self.settings.persist * self._short)
        self._stroke = stroke
        self._squares: deque[float] = deque(maxlen=self._long)
        self._travels: deque[float] = deque(maxlen=self._long)
        # A loop at rest knows of no range: an error that the stem's least step makes is in it.
        self._run_away = RunAway(max(before.largest, step), dead_time, self.settings)
        self._finest = step**2 / 12.0  # mean square of a staircase of such steps
        # The peaks of a cycle count once they are larger than before, and than such a step.
        peaks = max(before.mean_square, 0.5 * step**2)
        self._cycles = GrowingCycles(peaks, self.settings.cycles)
        square = max(before.mean_square, self._finest)
        self._harm = HarmWatch(square, before.travel, stroke, self.settings.harm)
        self._promise = PromiseWatch(
            square, before.travel, stroke, self._short, self.settings.promise
        )
        self._quietest = math.inf
        self._skip = self._patience = self._bad_for = self._excused = 0
        self._from = self._expected = 0.0
        self._nearest, self._stalled = math.inf, 0
        self._answer = min(dead_time + self.settings.trip_scans, self.settings.trip_latest)
        self._asked = 0.0
        self._way = SetpointWay(min(horizon // 2, self._short))

    def restart(self, skip: int) -> None:
        """Leave out the next ``skip`` samples (a set-point change), at most the short window, and
        as many again while the error has not changed its sign; what was seen before counts.
        """
        self._skip = self._patience = min(skip, self._short)
        self._from = self._expected = 0.0
        self._nearest, self._stalled = math.inf, 0
        self._way.restart()
        self._cycles.restart()

    def excuse(self, skip: int) -> None:
        """Leave out the next ``skip`` samples (a load step), once in a long window.

        What counts as running away stays what it is: a model that is wrong enough sees load steps
        all the time.
        """
        if self._excused == 0:
            self._excused = self._long
            self._skip = max(self._skip, min(skip, self._short))

    @property
    def judged(self) -> bool:
        """Whether enough settled scans were seen to say that compensation is worth it."""
        return self._promise.judged

    @property
    def longest_trial(self) -> int:
        """Scans after which a compensator counts as tried, however few of them were settled."""
        return 2 * self._long

    def push(self, seen: Watched) -> WatchVerdict:
        """Take in one sample."""
        self._quietest = min(self._quietest, seen.noise_variance)
        self._excused = max(0, self._excused - 1)
        if self._from == 0.0:
            # What is inside the known range anyhow is no way to a new set-point.
            self._from = seen.error
            outside = abs(seen.error) > self.before.largest
            self._expected = 1.1 * abs(seen.error) if outside else 0.0
        # The stem follows a set-point in steps: what is asked for is counted until it is done.
        self._asked += seen.sp_travel - self._asked / self._short
        noise = math.sqrt(self._quietest)
        on_the_way = self._skip > 0 or seen.limited
        same_side = seen.error * self._from > 0.0
        self._way.push(seen.sp_change, out_of_reach=seen.limited)
        returns = self._returns(abs(seen.error))
        arriving = self._expected if (on_the_way or returns) and same_side else 0.0
        expected = max(arriving, self._way.explains(seen.error))
        if self._run_away.push(seen, noise, expected):
            return WatchVerdict.LEFT_RANGE
        if self._overshoots(seen.error, noise):
            return WatchVerdict.GROWING
        unexplained = max(0.0, abs(seen.error) - expected)
        unasked = max(0.0, seen.travel - self._asked)
        if not seen.limited and self._harm.push(
            unexplained, unasked, self.settings.quiet * self._quietest
        ):
            return WatchVerdict.HUNTING
        if self._still_settling(seen.error) or seen.limited:
            return WatchVerdict.FINE
        # An error that the set-point explains is neither better nor worse than those of before.
        counted = max(unexplained, min(abs(seen.error), math.sqrt(self.before.mean_square)))
        self._squares.append(counted**2)
        self._travels.append(max(0.0, seen.travel - self._asked))
        self._asked = max(0.0, self._asked - seen.travel)
        if self._cycles.push(math.copysign(counted, seen.error), seen.noise_variance):
            return WatchVerdict.GROWING
        verdict, window = self._judge()
        early = len(self._squares) < window
        if (verdict is WatchVerdict.FINE or early) and seen.sp_travel == 0.0:
            broken = self._promised(seen)
            if broken is not WatchVerdict.FINE:
                return broken
        self._bad_for = 0 if verdict is WatchVerdict.FINE else self._bad_for + 1
        if self._bad_for <= self.settings.persist * self._short:
            return WatchVerdict.FINE
        return verdict

    def _returns(self, size: float) -> bool:
        """Whether an error has come nearer to zero than ever since the restart, of late."""
        self._stalled = 0 if size < self._nearest else self._stalled + 1
        self._nearest = min(size, self._nearest)
        return self._stalled < self._answer

    def _overshoots(self, error: float, noise: float) -> bool:
        """Whether PV went as far beyond SP as it was away from it, and far beyond all before."""
        known = math.sqrt(self.before.mean_square)
        if abs(self._from) < 3.0 * max(known, 2.0 * noise):
            return False
        usual = max(4.0 * known, 8.0 * noise, abs(self._from))
        return error * self._from < 0.0 and abs(error) > usual

    def _still_settling(self, error: float) -> bool:
        if self._skip > 0:
            self._skip -= 1
            return True
        if self._patience > 0 and error * self._from > 0.0:
            self._patience -= 1
            return True
        self._patience = 0
        return False

    def _judge(self) -> tuple[WatchVerdict, int]:
        """Return a verdict and the samples of the window that it is of."""
        s = self.settings
        # Beside the travel of before, a loop that was at rest may make two corrections a window.
        usual = self.before.travel
        allowance = 4.0 * self._stroke / self._long
        square, travel = self._means(self._quick)
        if travel > 3.0 * s.travel_budget * usual + 6.0 * self._stroke / self._quick:
            return WatchVerdict.TRAVEL, self._quick
        square, travel = self._means(self._short)
        if square > s.much_worse * self._room(travel) * self._usual(travel, self._short):
            return WatchVerdict.WORSE, self._short
        if travel > 1.5 * s.travel_budget * usual + 2.0 * allowance:
            return WatchVerdict.TRAVEL, self._short
        square, travel = self._means(self._long)
        known = self._usual(travel, self._long)
        if square > s.worse_by * self._room(travel) * known:
            return WatchVerdict.WORSE, self._long
        if travel > s.travel_budget * usual + allowance:
            return WatchVerdict.TRAVEL, self._long
        if travel > s.hunting * usual + allowance and square > s.hunting_share * known:
            return WatchVerdict.HUNTING, self._long
        return WatchVerdict.FINE, 0

    def _promised(self, seen: Watched) -> WatchVerdict:
        broken = self._promise.push(seen.error, self._travels[-1], seen.noise_variance, seen.stem)
        if not broken:
            return WatchVerdict.FINE
        return WatchVerdict.TRAVEL if broken == "travel" else WatchVerdict.NO_GAIN

    def _means(self, count: int) -> tuple[float, float]:
        """Return the mean square error and the mean travel of the last ``count`` samples.

        Of a window that is not full: what its means will be at least, however good the loop will
        be from now on, for as long as a verdict has to last. By then the first samples will have
        left the window, so that they are left out.
        """
        seen = len(self._squares)
        first = seen - count if seen >= count else min(self._lasting, seen)
        squares, travels = list(self._squares)[first:], list(self._travels)[first:]
        return math.fsum(squares) / count, math.fsum(travels) / count

    def _usual(self, travel: float, count: int) -> float:
        """Return the mean square that ``count`` scans with this travel may have.

        A stem at rest tolerates some deviations of the noise; one that travels has no such excuse,
        and a wrong model passes its own mistakes for noise.
        """
        s = self.settings
        rests = s.promise.rests(travel, self.before.travel, count, self._stroke)
        noise = s.quiet if rests else s.moving
        return max(self.before.mean_square, noise * self._quietest, self._finest)

    def _room(self, travel: float) -> float:
        """Return the factor of the mean square that is allowed for little travel."""
        return self.settings.at_rest if travel < 0.1 * self.before.travel else 1.0
