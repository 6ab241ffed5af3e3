"""Samples of a loop in the order of time, and their equally spaced form for the estimator."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

__all__ = ["Recorded", "Series", "equally_spaced", "steps_of"]

Floats = NDArray[np.float64]

_LATE = 1.8
"""Periods from one sample to the next from which on a sample is missing between them: a sample that
is late by three quarters of a period is followed by one that is early."""


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """A stretch of samples; arrays have the shape ``(n,)``, NaN marks a bad sample.

    Attributes:
        time: seconds, increasing; since 1970 (UTC) when ``dated``, else since the first sample.
        op, pv: controller output and process variable.
        sp, auto: set-point, and 1 in automatic; None where there is none.
        period: seconds between samples.
        slot: numbers of equally spaced slots where the recording has them.
    """

    time: Floats
    op: Floats
    pv: Floats
    sp: Floats | None
    auto: Floats | None
    period: float
    dated: bool
    slot: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return int(self.time.size)

    def part(self, rows: slice) -> Series:
        """The rows of a slice."""
        return replace(
            self,
            time=self.time[rows],
            op=self.op[rows],
            pv=self.pv[rows],
            sp=None if self.sp is None else self.sp[rows],
            auto=None if self.auto is None else self.auto[rows],
            slot=None if self.slot is None else self.slot[rows],
        )


class Recorded:
    """A recording that is in memory as a whole, read by time."""

    def __init__(self, series: Series) -> None:
        self._series = series
        self.dated = series.dated
        self.first = float(series.time[0])
        self.last = float(series.time[-1])

    def fetch(self, since: float, until: float, rows: int) -> Series:
        """At most ``rows`` samples from ``since`` on and before ``until``."""
        begin, end = np.searchsorted(self._series.time, [since, until])
        return self._series.part(slice(int(begin), int(min(end, begin + rows))))


def steps_of(series: Series) -> NDArray[np.int64]:
    """Slots from each sample to the next, shape ``(n - 1,)``: 1 without a gap."""
    elapsed = np.diff(series.time) / series.period
    steps = np.where(elapsed < _LATE, 1, np.round(elapsed)).astype(np.int64)
    if series.slot is not None:
        counted = np.diff(series.slot)
        # Slots are numbered anew when a daemon starts anew: then the clock counts.
        plausible = (counted > 0) & (np.abs(counted - elapsed) < 2.0)
        steps = np.where(plausible, counted, steps)
    return steps


def equally_spaced(series: Series, most: int) -> Series:
    """Put each sample into its slot, NaN where one is missing; ``most`` slots are kept."""
    slots = np.concatenate([[0], np.cumsum(steps_of(series))])
    kept = int(np.searchsorted(slots, most))
    if kept == int(slots[kept - 1]) + 1:
        return series.part(slice(0, kept))
    length = int(slots[kept - 1]) + 1
    places = slots[:kept]

    def placed(signal: Floats | None) -> Floats | None:
        if signal is None:
            return None
        spaced = np.full(length, np.nan)
        spaced[places] = signal[:kept]
        return spaced

    op, pv = placed(series.op), placed(series.pv)
    assert op is not None
    assert pv is not None
    time = series.time[0] + series.period * np.arange(length)
    return replace(
        series,
        time=time,
        op=op,
        pv=pv,
        sp=placed(series.sp),
        auto=placed(series.auto),
        slot=None,
    )
