"""The signals of a loop as the diagnosis uses them: of one length, without holes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from estimator.arrays import Array, Index, Mask
from estimator.cleaning import Held
from estimator.controller.controller import Controller
from estimator.diagnosis.facts import Limits, in_long_runs
from estimator.diagnosis.figures import few_steps, predictable_share, without_wave
from estimator.diagnosis.oscillation import (
    Oscillation,
    band_of,
    detect_oscillation,
    has_steady_period,
)
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.faults import runs_of
from estimator.monitoring.indices._signals import LEAST_SAMPLES
from estimator.outcomes import EstimatorError
from estimator.window import bridge, carry_on, period_of, signals_of

__all__ = [
    "LoopRecord",
    "explained_rows",
    "longest_stretch",
    "loop_record",
    "open_loop_swing",
    "predictable_shares",
    "with_own_setpoint",
    "without_setpoint_steps",
    "without_steady_wave",
]

_AT_REST = 2.0
"""Robust deviations of the error below which the answer to a set-point step is over."""
_STEP = 3.0
"""Robust deviations of the error above which a set-point step counts."""
_HELD = 2.0
"""Periods of the oscillation for which OP must stand still at a stretch."""
_GOES_ON = 0.5
"""Size of the oscillation in that time over its usual size, from which it goes on."""


@dataclass(frozen=True, slots=True)
class LoopRecord:
    """The signals of a loop, whole and without holes."""

    op: Array
    pv: Array | None
    sp: Array | None
    auto: Mask | None
    error: Array | None
    good: Mask
    period: float

    def part(self, rows: slice) -> LoopRecord:
        """These rows of the record."""
        return self._rows(rows, rows.step or 1)

    def thinned(self, held: Held) -> LoopRecord:
        """Each value once."""
        return self._rows(held.at, held.every) if held.why else self

    def _rows(self, rows: slice | Index, every: float) -> LoopRecord:
        def cut(signal: Array | None) -> Array | None:
            return None if signal is None else signal[rows]

        return LoopRecord(
            op=self.op[rows],
            pv=cut(self.pv),
            sp=cut(self.sp),
            auto=None if self.auto is None else self.auto[rows],
            error=cut(self.error),
            good=self.good[rows],
            period=self.period * every,
        )


def longest_stretch(record: LoopRecord, hole: int) -> slice:
    """The longest stretch in automatic in which no more than ``hole`` samples in a row are bad."""
    bad = ~record.good
    if record.auto is not None:
        bad = bad | ~record.auto
    holes = [(start, stop) for start, stop in runs_of(bad) if stop - start > hole]
    ends = [(0, 0), *holes, (bad.size, bad.size)]
    stretches = [slice(before[1], after[0]) for before, after in pairwise(ends)]
    return max(stretches, key=lambda one: one.stop - one.start)


def loop_record(
    op: ArrayLike,
    pv: ArrayLike | None,
    sp: ArrayLike | None,
    auto: ArrayLike | None,
    period: float,
) -> LoopRecord:
    """Check the signals of a loop and bridge their holes; errors as `diagnose` has them."""
    period = period_of(period)
    recorded, given = signals_of(op, {"pv": pv, "sp": sp, "auto": auto})
    if recorded.size < LEAST_SAMPLES:
        raise EstimatorError(
            f"a record of {recorded.size} samples is too short: give {LEAST_SAMPLES}, and 50 for "
            f"the valve"
        )
    u, good = bridge(recorded, "op"), np.isfinite(recorded)
    if "pv" not in given:
        return LoopRecord(u, None, None, None, None, good, period)
    y = bridge(given["pv"], "pv")
    good &= np.isfinite(given["pv"])
    target = carry_on(given["sp"]) if "sp" in given else None
    mode = None
    if "auto" in given:
        mode = np.isfinite(given["auto"]) & (given["auto"] != 0.0)
    error = (target if target is not None else float(np.mean(y))) - y
    return LoopRecord(u, y, target, mode, np.asarray(error), good, period)


def with_own_setpoint(
    record: LoopRecord, controller: Controller | None, settings: DiagnosisSettings
) -> LoopRecord:
    """The record with the error to the set-point that OP's own moves show, where none was recorded.

    A controller moves OP by its integral rate times the error, so the mean of the moves tells the
    mean error. The mean of PV tells it only as long as no limit and no hand holds OP.
    """
    if record.sp is not None or record.pv is None or record.error is None:
        return record
    if controller is None or not controller.integral_rate:
        return record
    free = record.good & ~in_long_runs(record.op, settings.facts.least_run)
    if record.auto is not None:
        free &= record.auto
    rows = free[1:] & free[:-1]
    if int(rows.sum()) < settings.facts.least_run:
        return record
    moves = np.diff(record.op) + controller.gain * np.diff(record.pv)
    asked = float(np.mean(moves[rows])) / (controller.integral_rate * record.period)
    target = float(np.mean(record.pv[1:][rows])) + asked
    if not record.pv.min() <= target <= record.pv.max():
        return record
    return replace(record, error=target - record.pv)


def explained_rows(
    record: LoopRecord, swing: Oscillation, settings: DiagnosisSettings
) -> LoopRecord:
    """The rows that are explained: of bounded number, with enough samples and enough periods.

    A slow oscillation is thinned, so that a window holds its periods; a fast one is cut to the
    last rows. Of a record with more bad samples than can be explained the longest stretch counts.
    """
    scope = settings.scope
    if record.good.mean() < 1.0 - scope.most_bad:
        stretch = longest_stretch(record, scope.hole)
        if stretch.stop - stretch.start >= settings.swinging.least_samples:
            record = record.part(stretch)
    size = record.op.size
    if swing.present:
        # no more than brings the whole record into the window
        every = min(
            max(1, int(swing.period_s / record.period // scope.per_period)),
            math.ceil(size / scope.rows),
        )
        if size // every < scope.rows // 2:
            # few periods: as many rows as there are, within bounds
            every = max(1, size // scope.rows)
    else:
        every = max(1, size // (2 * scope.rows))
    return record.part(slice(max(0, size - scope.rows * every), None, every))


def predictable_shares(
    record: LoopRecord,
    swing: Oscillation,
    controller: Controller | None,
    limits: Limits,
    settings: DiagnosisSettings,
) -> tuple[float, float]:
    """Shares of the error that are predictable one and two integral times ahead.

    Samples in manual, at a limit, and those that an integral time later still show it do not count.
    """
    nothing = (math.nan, math.nan)
    if controller is None or not math.isfinite(controller.integral_time_s):
        return nothing
    assert record.error is not None
    ahead = round(controller.integral_time_s / record.period)
    if not 0 < ahead <= settings.judging.seen * record.op.size:
        return nothing
    free = record.good.copy()
    if record.auto is not None:
        free &= record.auto
    if limits.share >= settings.facts.least_limit:
        free &= ~limits.where
    held = np.flatnonzero(~free)
    for at in held[np.diff(held, append=record.op.size + 2) > 1]:
        free[at : at + 2 * ahead] = False
    if free.mean() < 0.5:
        return nothing
    error = record.error
    # a wave is predictable for ever, however the loop is tuned
    error = without_steady_wave(error, swing, record.period, settings)
    error = np.where(free, error, np.nan)
    return predictable_share(error, ahead), predictable_share(error, 2 * ahead)


def without_steady_wave(
    signal: Array, swing: Oscillation, period: float, settings: DiagnosisSettings
) -> Array:
    """The signal ``(n,)`` without the main oscillation, where that has a steady period."""
    if not swing.present or not has_steady_period(swing, settings.judging):
        return signal
    return without_wave(signal, swing.period_s / period)


def without_setpoint_steps(error: Array, sp: Array | None) -> Array:
    """The error ``(n,)`` with straight lines across the loop's answers to set-point steps.

    They are the largest motion of many a record and have no period. An answer ends where the error
    first comes back to its usual size.
    """
    if sp is None:
        return error
    at = np.flatnonzero(np.diff(sp)) + 1
    if at.size == 0 or at.size > few_steps(sp.size):
        return error
    middle = float(np.median(error))
    usual = float(np.median(np.abs(error - middle))) / 0.6745
    left = error.copy()
    for start, stop in zip(at, [*at[1:], sp.size], strict=True):
        if abs(sp[start] - sp[start - 1]) < _STEP * usual:
            continue
        over = np.flatnonzero(np.abs(error[start:stop] - middle) < _AT_REST * usual)
        left[start : start + (int(over[0]) if over.size else stop - start)] = np.nan
    return bridge(left) if np.isfinite(left).any() else error


def open_loop_swing(
    record: LoopRecord, swing: Oscillation, is_open: Mask, settings: DiagnosisSettings
) -> Oscillation | None:
    """The steady oscillation that goes on in the longest time in which OP stands still, or None.

    Either it is that of the whole record, or one that shows in that time alone.
    """
    assert record.pv is not None
    assert record.error is not None
    start, stop = max(runs_of(is_open), key=lambda run: run[1] - run[0], default=(0, 0))
    steady, samples = settings.judging.steady, swing.period_s / record.period
    if swing.present and swing.regularity >= steady and stop - start >= _HELD * samples:
        band = band_of(record.error, 1.0 / samples, settings.swinging)
        if float(np.std(band[start:stop])) > _GOES_ON * float(np.std(band)):
            return swing
    if stop - start < settings.swinging.least_samples:
        return None
    found = detect_oscillation(
        record.pv[start:stop], period=record.period, settings=settings.swinging
    )
    return found if found.present and found.regularity >= steady else None
