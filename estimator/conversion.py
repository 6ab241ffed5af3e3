"""From a simulation model in scaled units to the ARX form of ``loop_model`` in plant units."""

from __future__ import annotations

import math
from types import MappingProxyType

import numpy as np

from estimator.regression import LinearFit
from estimator.result import Interval, Process
from estimator.structures import Structure
from estimator.window import Window
from loop_model import ProcessModel

__all__ = ["process_description", "process_model"]


def process_model(
    window: Window, structure: Structure, dead_time: int, fit: LinearFit
) -> ProcessModel:
    """The ARX form (7)-(8) of poles, gain and dead time: exact, in units of OP and PV."""
    a = np.array([1.0])
    for pole in structure.poles:
        a = np.convolve(a, [1.0, -pole])
    rest = float(np.prod([1.0 - p for p in structure.poles if p < 1.0]))
    slope = fit.gain * window.pv_scale / window.op_span
    if structure.integrating:
        # scaled PV rises by (gain * stem + drift) / n per sample in steady state
        b = slope * rest / window.size
        drift = float(fit.columns[1]) * window.pv_scale / window.size
        offset = drift * rest - b * window.op_centre
    else:
        b = slope * rest
        level = window.pv_centre + window.pv_scale * float(fit.columns[0])
        offset = level * rest - b * window.op_centre
    return ProcessModel(
        a=tuple(float(v) for v in a[1:]),
        b=(b,),
        dead_time=dead_time,
        offset=offset,
        period=window.period,
    )


def process_description(
    window: Window, structure: Structure, model: ProcessModel, gain_share: Interval
) -> Process:
    """Names and numbers of the process for a reader; ``gain_share`` is the scaled gain."""
    parameters: dict[str, float] = {}
    scale = window.pv_scale / window.op_span
    constants = [-window.period / math.log(p) for p in structure.poles if p < 1.0]
    for i, constant in enumerate(constants, start=1):
        name = "time_constant" if len(constants) == 1 else f"time_constant_{i}"
        parameters[name] = constant
    if structure.integrating:
        parameters["integral_gain"] = gain_share.value * scale / (window.size * window.period)
        gain = Interval(math.copysign(math.inf, gain_share.value), math.nan, math.nan)
    else:
        gain = gain_share.scaled(scale)
    parameters["offset"] = model.offset
    parameters["dead_time"] = model.dead_time * window.period
    return Process(structure.name, MappingProxyType(parameters), model.dead_time, gain)
