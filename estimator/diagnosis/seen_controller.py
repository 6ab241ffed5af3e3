"""The controller of a record, read with PV as the controller saw it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from estimator.arrays import Array
from estimator.controller.controller import Controller
from estimator.controller.reading import read_aligned, read_controller
from estimator.controller.shifts import find_shift, shifted
from estimator.diagnosis.loop_record import LoopRecord, loop_record
from estimator.diagnosis.settings import DiagnosisSettings

__all__ = ["read_seen"]


def read_seen(
    record: LoopRecord, settings: DiagnosisSettings
) -> tuple[Controller | None, LoopRecord, int]:
    """The controller, the record with PV as that saw it, and the samples by which PV was late."""

    def read(one: LoopRecord, pv: Array) -> Controller | None:
        return read_controller(
            one.op, pv, one.sp, auto=one.auto, period=one.period, settings=settings.reading
        )

    # a sample that was bridged is none that the controller saw
    assert record.pv is not None
    measured = np.where(record.good, record.pv, math.nan)
    found = read(record, measured)
    if found is not None and found.timed:
        return found, record, 0
    aligned = read_aligned(record.op, measured, record.sp, settings.reading)
    late = aligned.late
    if aligned.controller is None:
        action = 0.0 if found is None else math.copysign(1.0, found.gain or found.integral_rate)
        late = find_shift(_in_auto(record), measured, record.sp, action, settings.reading)
    if late == 0:
        return found, record, 0
    moved = _moved(record, measured, late)
    assert moved.pv is not None
    again = read(moved, np.where(moved.good, moved.pv, math.nan))
    if again is None or (found is not None and again.action != found.action):
        # not the controller's law: the process's
        return found, record, 0
    return replace(again, timed=True), moved, late


def _in_auto(record: LoopRecord) -> Array:
    """OP, NaN where a hand moves it."""
    return record.op if record.auto is None else np.where(record.auto, record.op, math.nan)


def _moved(record: LoopRecord, measured: Array, late: int) -> LoopRecord:
    """The record with PV moved forward by ``late`` samples, or OP where that is negative."""
    auto = None if record.auto is None else record.auto.astype(float)
    op = shifted(record.op, -late)
    return loop_record(op, shifted(measured, late), record.sp, auto, record.period)
