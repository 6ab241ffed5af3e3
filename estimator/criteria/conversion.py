"""From a hypothesis in scaled units to the ARX form of ``loop_model`` in plant units."""

from __future__ import annotations

import math
from types import MappingProxyType

import numpy as np

from estimator.hypotheses.linear_fit import LinearFit
from estimator.processes.poles import Poles, Shape
from estimator.result import Interval, Process
from estimator.window import Window
from loop_model import ProcessModel

__all__ = ["describe_process", "process_model"]


def process_model(
    window: Window, poles: Poles, dead_time: int, fit: LinearFit, first_stem: float
) -> ProcessModel:
    """The ARX form (7)-(8), exact, in units of OP and PV.

    ``first_stem`` is the scaled stem at the first sample: a response counts from there. The first
    column of ``fit`` is the offset, the last of the shared ones the straight line where the process
    integrates.
    """
    a = np.array([1.0, *poles.denominator])
    steep = window.pv_scale / window.op_span
    b = fit.gains * poles.numerator * steep
    level = window.pv_centre + window.pv_scale * float(fit.columns[0])
    line = 0.0
    if poles.integrating:
        line = window.pv_scale * float(fit.columns[2]) / window.size
    at_rest = window.op_centre + window.op_span * first_stem
    # A(q) of a level and of a straight line, the latter at any sample where A(1) is 0
    offset = float(a.sum()) * level - line * float(a @ np.arange(a.size)) - float(b.sum()) * at_rest
    used = b if abs(b[1]) > 0.0 else b[:1]
    if b[0] == 0.0 and b[1] != 0.0:
        used, dead_time = b[1:], dead_time + 1
    return ProcessModel(
        a=tuple(float(v) for v in a[1:]),
        b=tuple(float(v) for v in used),
        dead_time=dead_time,
        offset=offset,
        period=window.period,
    )


def describe_process(window: Window, poles: Poles, model: ProcessModel, gain: Interval) -> Process:
    """Names and numbers for a reader; ``gain`` is in PV per OP."""
    period = window.period
    parameters: dict[str, float] = {}
    if poles.shape is Shape.SWINGING:
        parameters |= {"swing_period": poles.slow * period, "damping": poles.fast}
        name = "swinging pair"
        lags = [poles.third]
    else:
        lags = [poles.fast, poles.third]
        if not poles.integrating:
            lags = [poles.slow, *lags]
        count = sum(t > 0.0 for t in lags)
        name = ("gain", "lag", "two lags", "three lags")[count]
        if poles.integrating:
            name = "integrating" + (f" with {name}" if count else "")
    constants = sorted((t * period for t in lags if t > 0.0), reverse=True)
    for i, constant in enumerate(constants, start=1):
        parameters["time_constant" if len(constants) == 1 else f"time_constant_{i}"] = constant
    if poles.integrating:
        parameters["integral_gain"] = gain.value
        gain = Interval(math.copysign(math.inf, gain.value), math.nan, math.nan)
    parameters["offset"] = model.offset
    # two coefficients of the stem are a dead time between two samples
    late = model.dead_time + (model.b[1] / math.fsum(model.b) if len(model.b) == 2 else 0.0)
    parameters["dead_time"] = late * period
    return Process(name, MappingProxyType(parameters), round(late), gain)
