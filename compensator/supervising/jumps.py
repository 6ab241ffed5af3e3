"""A jump of PV that no process can make within a scan is the transmitter's, not the process's.

A stem that goes all the way that OP went of late, and a load that comes at once, change PV within a
scan by no more than the process's fastest response makes of them. A value beyond that and beyond
many deviations of what PV does from scan to scan is a bad sample, as NaN is: one scan of a wrong
word order, of a loose wire. What stays there is believed after a few scans: the model may be wrong,
or the sensor another one.

Example: a lag of 14 scans with a gain of 1.3 makes at most 0.09 per OP in a scan. Where OP went by
6 and the stick band is 6, a jump beyond 0.09 times 30 and ten deviations is a fault.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from compensator.action import require_not_negative, require_whole
from compensator.prediction import Prediction
from compensator.supervising.figures import Sample
from loop_model import ValveModel

__all__ = ["JumpScreen", "JumpSettings", "span_of", "without_jumps"]

_TO_DEVIATION = 0.6745
"""Deviations of a normal distribution within which half of its values lie."""


@dataclass(frozen=True, slots=True)
class JumpSettings:
    """Settings of `JumpScreen`.

    Attributes:
        load: stick bands of load that may come within one scan; a larger one is seen ``scans``
            later.
        deviations: of PV's changes from scan to scan that a jump must be beyond: noise does not
            reach ten, and the changes of a few scans tell their deviation to a third.
        changes: latest changes of PV that tell their deviation, by their median.
        scans: jumps in a row that are bad samples. The next one is believed, and the base
            controller gets the loop: what holds for longer is the transmitter's new value or the
            process's, and neither is what the compensator has followed.
    """

    load: float = 3.0
    deviations: float = 10.0
    changes: int = 21
    scans: int = 3

    def __post_init__(self) -> None:
        require_not_negative("JumpSettings", load=self.load, deviations=self.deviations)
        require_whole("JumpSettings", 1, changes=self.changes, scans=self.scans)


class JumpScreen:
    """Turns a PV that jumped into NaN, one `check` a scan.

    Args:
        settings: what a jump is.

    Attributes:
        believed: whether the last PV is a jump that has lasted for too long to be left out.
    """

    def __init__(self, settings: JumpSettings | None = None) -> None:
        self.settings = settings or JumpSettings()
        self.believed = False
        self._last = math.nan
        self._missing = self._jumps = 0
        self._changes: deque[float] = deque(maxlen=self.settings.changes)

    def check(
        self, pv: float, prediction: Prediction, valve: ValveModel, op_span: Callable[[], float]
    ) -> float:
        """Return PV of this scan, NaN where it is bad or jumped.

        Args:
            pv: as measured.
            prediction: the process.
            valve: the valve.
            op_span: returns how far OP went in the latest scans; asked only of a large change.
        """
        self.believed = False
        if not math.isfinite(pv):
            self._missing += 1
            return math.nan
        change = abs(pv - self._last)
        if math.isfinite(change) and change > self._usual():
            way = op_span() + (1.0 + self.settings.load) * valve.stick_band
            jumped = change > self._usual() + (1 + self._missing) * prediction.fastest * way
            if jumped and self._jumps < self.settings.scans:
                self._jumps += 1
                return math.nan
            self.believed = jumped
        if not (self._missing or self._jumps) and math.isfinite(change):
            self._changes.append(change)
        self._last, self._missing, self._jumps = pv, 0, 0
        return pv

    def _usual(self) -> float:
        """Return the change of PV that is no reason to ask; none is while few were seen."""
        if 2 * len(self._changes) < self.settings.changes:
            return math.inf
        median = sorted(self._changes)[len(self._changes) // 2]
        return self.settings.deviations * median / _TO_DEVIATION


def without_jumps(
    samples: Sequence[Sample],
    prediction: Prediction,
    valve: ValveModel,
    horizon: int,
    screen: JumpScreen,
) -> list[Sample]:
    """Return a record with NaN for each PV that jumped.

    Args:
        samples: the record, oldest first.
        prediction: the process.
        valve: the valve.
        horizon: scans in which a move of the stem still changes PV.
        screen: a new one, which knows afterwards what the latest scans were like.
    """
    cleaned = []
    for k, sample in enumerate(samples):
        recent = samples[max(0, k - horizon) : k + 1]
        pv = screen.check(sample.pv, prediction, valve, partial(span_of, recent))
        cleaned.append(Sample(pv, sample.sp, sample.op, sample.by_base))
    return cleaned


def span_of(samples: Sequence[Sample]) -> float:
    """Return how far OP went in a stretch."""
    ops = [sample.op for sample in samples]
    return max(ops, default=0.0) - min(ops, default=0.0)
