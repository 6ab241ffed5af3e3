"""How much of the control error better settings would remove, without simulating the record.

Robust settings for the identified process change the error at each frequency by the ratio of the
two sensitivities; limits, a sticking valve and the process's uncertainty are left aside. It is
enough to tell a slow loop from a well-tuned one under slow loads; `tuning` predicts with care.
"""

from __future__ import annotations

import math

import numpy as np

from estimator.arrays import Array
from estimator.controller.controller import Controller
from estimator.diagnosis.linear_loop import LinearLoop
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.diagnosis.tuning_rules import largest_integral_gain
from loop_model import ProcessModel

__all__ = ["removable_share"]


def removable_share(
    error: Array,
    process: ProcessModel | None,
    controller: Controller | None,
    period: float,
    settings: DiagnosisSettings,
) -> float:
    """Share of the squared error that robust settings would remove from a record, or NaN.

    Args:
        error: control error without holes, ``(n,)``.
        process, controller: what was identified; None where it could not be.
        period: seconds between samples.
        settings: see `estimator.diagnosis.settings`.
    """
    if process is None or controller is None or not controller.integral_rate:
        return math.nan
    better = largest_integral_gain(process, controller, settings.advising.robustness)
    if better is None or better.integral_rate * controller.integral_rate <= 0.0:
        return math.nan
    lines = np.fft.rfft((error - error.mean()) * np.hanning(error.size))
    loop = LinearLoop.of(process, controller)
    # cycles a sample of the process's model; what is faster than its samples stays as it is
    f = np.asarray(np.fft.rfftfreq(error.size), dtype=np.float64) * loop.period / period
    known = (f > 0.0) & (f < 0.5)
    change = np.ones(f.size)
    robust = LinearLoop.of(process, better).sensitivity(f[known])
    change[known] = np.abs(robust) / np.maximum(np.abs(loop.sensitivity(f[known])), 1e-9)
    whole = float(np.sum(np.abs(lines) ** 2))
    return 1.0 - float(np.sum(np.abs(lines * change) ** 2)) / whole if whole > 0.0 else math.nan
