"""Samples of a loop in the order of time, and their equally spaced form for the estimator."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.missing_rows import missing_between, put_into_slots
from fieldlink.site.number_cells import NO_VALUE_FROM

__all__ = [
    "Recorded",
    "Series",
    "equally_spaced",
    "runs_in_order",
    "steps_of",
    "without_bad_values",
    "without_repeats",
]

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """A stretch of samples; arrays have the shape ``(n,)``, NaN marks a bad sample.

    Attributes:
        time: seconds, increasing; since 1970 (UTC) when ``dated``, else since the first sample.
        op, pv: controller output and process variable.
        sp, auto: set-point, and 1 in automatic; None where there is none.
        period: seconds between samples.
        slot: numbers of equally spaced slots where the recording has them.
        notes: how the recording was read, in words.
    """

    time: Floats
    op: Floats
    pv: Floats
    sp: Floats | None
    auto: Floats | None
    period: float
    dated: bool
    slot: NDArray[np.int64] | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return int(self.time.size)

    def part(self, rows: slice | NDArray[np.bool_]) -> Series:
        """The rows of a slice, or those that are marked."""
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


def without_bad_values(series: Series) -> Series:
    """NaN for the numbers that mark a sample without a value, as in a text file."""

    def values(signal: Floats) -> Floats:
        return np.where(np.abs(signal) < NO_VALUE_FROM, signal, np.nan)

    sp = None if series.sp is None else values(series.sp)
    return replace(series, op=values(series.op), pv=values(series.pv), sp=sp)


def without_repeats(series: Series) -> Series:
    """Of rows with the same time, the last one: a table may hold a moment twice."""
    is_last = np.append(np.diff(series.time) > 0.0, np.ones(min(1, len(series)), dtype=np.bool_))
    if is_last.all():
        return series
    count = int(np.count_nonzero(~is_last))
    note = f"{count} rows have the moment of another, and the last one counts: a clock set back?"
    return replace(series.part(is_last), notes=(*series.notes, note))


def runs_in_order(series: Series) -> Iterator[Series]:
    """The parts of a recording in which the clock does not go back.

    A clock that is set back, as local time is in autumn, shows the same hour twice: each hour is in
    a part of its own. Where it goes back by less than a period, the stamp is only inexact.
    """
    back = np.flatnonzero(np.diff(series.time) < -series.period) + 1
    for begin, end in pairwise([0, *back.tolist(), len(series)]):
        part = series.part(slice(begin, end))
        yield replace(part, time=np.maximum.accumulate(part.time))


def steps_of(series: Series) -> NDArray[np.int64]:
    """Slots from each sample to the next, shape ``(n - 1,)``: 1 without a gap."""
    elapsed = np.diff(series.time) / series.period
    steps = 1 + missing_between(elapsed)
    if series.slot is not None:
        counted = np.diff(series.slot)
        # Slots are numbered again when a daemon starts again: then the clock counts.
        plausible = (counted > 0) & (np.abs(counted - elapsed) < 2.0)
        steps = np.where(plausible, counted, steps)
    return steps


def equally_spaced(series: Series, most: int) -> Series:
    """Put each sample into its slot, NaN where one is missing; ``most`` slots are kept."""
    slots = np.concatenate([[0], np.cumsum(steps_of(series))])
    kept = int(np.searchsorted(slots, most))
    length = int(slots[kept - 1]) + 1
    if kept == length:
        return series.part(slice(0, kept))

    def placed(signal: Floats) -> Floats:
        return put_into_slots(signal[:kept], slots[:kept])

    return replace(
        series,
        time=series.time[0] + series.period * np.arange(length),
        op=placed(series.op),
        pv=placed(series.pv),
        sp=None if series.sp is None else placed(series.sp),
        auto=None if series.auto is None else placed(series.auto),
        slot=None,
    )
