"""The signals of a loop as the diagnosis uses them: of one length, without holes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estimator.arrays import Array, Mask
from estimator.diagnosis.controller import Controller
from estimator.diagnosis.facts import Limits
from estimator.diagnosis.figures import predictable_share
from estimator.diagnosis.oscillation import Oscillation, bridge
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.outcomes import EstimatorError

__all__ = ["LoopRecord", "explained_rows", "loop_record", "predictable_shares"]


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


def loop_record(
    op: ArrayLike,
    pv: ArrayLike | None,
    sp: ArrayLike | None,
    auto: ArrayLike | None,
    period: float,
) -> LoopRecord:
    """Check the signals of a loop and bridge their holes; errors as `diagnose` has them."""
    if not (math.isfinite(period) and period > 0.0):
        raise EstimatorError(f"period is {period!r}: give the seconds between samples, above zero")
    u = bridge(op)
    good = np.isfinite(np.asarray(op, dtype=float))
    given = [("pv", pv), ("sp", sp), ("auto", auto)]
    for name, values in given:
        if values is not None and np.asarray(values).shape != u.shape:
            raise EstimatorError(
                f"op has {u.size} samples and {name} has {np.asarray(values).size}: give every "
                f"signal of the window with the same number of samples"
            )
    if pv is None:
        return LoopRecord(u, None, None, None, None, good, period)
    y = bridge(pv)
    good &= np.isfinite(np.asarray(pv, dtype=float))
    target = None if sp is None or not np.isfinite(np.asarray(sp, float)).any() else bridge(sp)
    mode = None if auto is None else np.asarray(auto, dtype=float) > 0.0
    error = (target if target is not None else float(np.mean(y))) - y
    return LoopRecord(u, y, target, mode, np.asarray(error), good, period)


def explained_rows(
    record: LoopRecord, swing: Oscillation, settings: DiagnosisSettings
) -> LoopRecord:
    """The rows that are explained: of bounded number, with enough samples and enough periods.

    A slow oscillation is thinned, so that a window holds its periods; a fast one is cut to the
    last rows.
    """
    scope = settings.scope
    size = record.op.size
    if swing.present:
        every = max(1, int(swing.period_s / record.period // scope.per_period))
        if size // every < scope.rows // 2:
            # few periods: as many rows as there are, within bounds
            every = max(1, size // scope.rows)
    else:
        every = max(1, size // (2 * scope.rows))
    rows = slice(max(0, size - scope.rows * every), None, every)

    def cut(signal: Array | None) -> Array | None:
        return None if signal is None else signal[rows]

    return LoopRecord(
        op=record.op[rows],
        pv=cut(record.pv),
        sp=cut(record.sp),
        auto=None if record.auto is None else record.auto[rows],
        error=cut(record.error),
        good=record.good[rows],
        period=record.period * every,
    )


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
    if controller is None or not math.isfinite(controller.integral_time_s) or swing.present:
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
    error = np.where(free, record.error, np.nan)
    return predictable_share(error, ahead), predictable_share(error, 2 * ahead)
