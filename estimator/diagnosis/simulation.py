"""What another controller would have done to this record: the real disturbance, simulated again."""

from __future__ import annotations

import math

import numpy as np

from compiled import kernel
from estimator.arrays import Array
from estimator.diagnosis.controller import Controller
from loop_model import ProcessModel

__all__ = ["disturbance_of", "resimulate"]


def disturbance_of(process: ProcessModel, stem: Array, pv: Array) -> Array:
    """What PV holds beside the process's answer to the stem, ``(n,)``, as a signal on PV."""
    steady = process
    if process.is_integrating:
        # without an offset: a ramp of its own belongs to the disturbance
        steady = ProcessModel(process.a, process.b, process.dead_time, 0.0, process.period)
        return np.asarray(pv - steady.simulate(stem - stem[0]))
    return np.asarray(pv - steady.simulate(stem))


@kernel
def _run(
    a: Array, b: Array, dead: int, kp: float, ki: float, kd: float, pole: float, sp: Array,
    disturbance: Array, op0: float, low: float, high: float, level: float, static: float,
    dynamic: float,
) -> Array:  # fmt: skip
    """Closed loop ``(2, n)``: OP and PV; ``level`` is PV's part that the process does not make."""
    n = sp.size
    out = np.empty((2, n))
    x = np.zeros(n)
    g = np.zeros(n)
    op = op0
    stem = op0
    last_e = last_y = older_y = last_move = 0.0
    for k in range(n):
        total = 0.0
        for i in range(a.size):
            if k - 1 - i >= 0:
                total -= a[i] * g[k - 1 - i]
        for i in range(b.size):
            at = k - dead - i
            if at >= 0 and at < k:
                total += b[i] * x[at]
        g[k] = total
        y = g[k] + disturbance[k] + level
        e = sp[k] - y
        if k == 0:
            last_e, last_y, older_y = e, y, y
        move = kp * (e - last_e) + ki * e - kd * (y - 2.0 * last_y + older_y)
        move = pole * last_move + (1.0 - pole) * move
        last_move = move
        op = min(max(op + move, low), high)
        older_y, last_y, last_e = last_y, y, e
        gap = op - stem
        if gap > static:
            stem = op - dynamic
        elif gap < -static:
            stem = op + dynamic
        x[k] = stem - op0
        out[0, k], out[1, k] = op, y
    return out


def resimulate(
    process: ProcessModel,
    controller: Controller,
    sp: Array,
    disturbance: Array,
    op0: float,
    limits: tuple[float, float] = (-math.inf, math.inf),
    friction: tuple[float, float] = (0.0, 0.0),
) -> tuple[Array, Array]:
    """OP and PV ``(n,)`` of the loop under a controller, from the same start.

    Args:
        process: its response counts from ``op0``.
        controller: gains in units of OP over PV.
        sp: set-point, ``(n,)``.
        disturbance: what PV holds beside the process's answer, ``(n,)``; see `disturbance_of`.
        op0: OP before the first sample.
        limits: of OP.
        friction: fS and fD of the valve, units of OP.
    """
    h = process.period
    rest = 0.0
    if not process.is_integrating:
        rest = (sum(process.b) * op0 + process.offset) / (1.0 + sum(process.a))
    pole = math.exp(-h / controller.filter_time_s) if controller.filter_time_s > 0.0 else 0.0
    found = _run(
        np.array(process.a, dtype=np.float64),
        np.array(process.b, dtype=np.float64),
        max(1, process.dead_time),
        controller.gain,
        controller.integral_rate * h,
        controller.gain * controller.derivative_time_s / h,
        pole,
        np.ascontiguousarray(sp),
        np.ascontiguousarray(disturbance),
        op0,
        limits[0],
        limits[1],
        rest,
        friction[0],
        friction[1],
    )
    return found[0], found[1]
