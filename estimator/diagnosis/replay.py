"""What another controller would have done to this record: its own disturbance, simulated again."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from compiled import kernel
from estimator.arrays import Array
from estimator.controller.controller import Controller
from loop_model import ProcessModel

__all__ = ["Replay"]


@dataclass(frozen=True, slots=True)
class Replay:
    """A record taken apart: what the process made of the stem, and the rest.

    Attributes:
        process: its response counts from ``rest``.
        rest: OP at which the process rests; at the beginning OP where the process does not
            integrate.
        disturbance: what PV holds beside the process's answer, ``(n,)``, as a signal on PV.
    """

    process: ProcessModel
    rest: float
    disturbance: Array

    @classmethod
    def of(cls, process: ProcessModel, stem: Array, pv: Array) -> Replay:
        """Take a record apart; ``stem`` and ``pv`` are ``(n,)`` without holes."""
        b = np.concatenate([np.zeros(process.dead_time), process.b])
        a = np.array([1.0, *process.a])
        rest = float(stem[0])
        left = np.asarray(pv - scipy.signal.lfilter(b, a, stem - rest))
        if process.is_integrating:
            # a steady load ramps PV: it belongs to the rest of OP
            ramp = np.asarray(scipy.signal.lfilter(b, a, np.ones(stem.size)))
            design = np.stack([ramp, np.ones(stem.size)], axis=1)
            load = float(np.linalg.lstsq(design, left, rcond=None)[0][0])
            rest, left = rest - load, left - load * ramp
        return cls(process, rest, left)

    def run(
        self,
        controller: Controller,
        sp: Array,
        limits: tuple[float, float] = (-math.inf, math.inf),
        friction: tuple[float, float] = (0.0, 0.0),
        *,
        slides: bool = False,
    ) -> tuple[Array, Array]:
        """OP and PV ``(n,)`` of the loop under a controller.

        The record runs backwards first, so that a limit cycle or a slow loop is under way when the
        record itself begins.

        Args:
            controller: gains in units of OP over PV.
            sp: set-point, ``(n,)``.
            limits: of OP.
            friction: fS and fD of the valve, units of OP.
            slides: whether its stem, once it moves, follows OP until OP stops or turns.
        """
        h, process = self.process.period, self.process
        late = controller.filter_time_s
        found = _run(
            np.array(process.a, dtype=np.float64),
            np.array(process.b, dtype=np.float64),
            max(1, process.dead_time),
            controller.gain,
            controller.integral_rate * h,
            controller.gain * controller.derivative_time_s / h,
            math.exp(-h / late) if late > 0.0 else 0.0,
            np.concatenate([sp[::-1], sp]),
            np.concatenate([self.disturbance[::-1], self.disturbance]),
            self.rest,
            limits[0],
            limits[1],
            friction[0],
            friction[1],
            1.0 if slides else 0.0,
            1.0 if controller.filter_on == "derivative" else 0.0,
        )
        return found[0, sp.size :], found[1, sp.size :]


@kernel
def _run(
    a: Array, b: Array, dead: int, kp: float, ki: float, kd: float, pole: float, sp: Array,
    disturbance: Array, rest: float, low: float, high: float, static: float, dynamic: float,
    slides: float, derivative: float,
) -> Array:  # fmt: skip
    """Closed loop ``(2, n)``: OP and PV; the valve's laws are those of `estimator.valves.laws`."""
    n = sp.size
    out = np.empty((2, n))
    x = np.zeros(n)
    g = np.zeros(n)
    op = min(max(rest, low), high)
    stem = op
    last_e = last_y = older_y = last_move = way = 0.0
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
        y = g[k] + disturbance[k]
        e = sp[k] - y
        if k == 0:
            last_e, last_y, older_y = e, y, y
        quick = -kd * (y - 2.0 * last_y + older_y)
        slow = kp * (e - last_e) + ki * e
        filtered = quick if derivative > 0.0 else slow + quick
        last_move = pole * last_move + (1.0 - pole) * filtered
        move = last_move + slow if derivative > 0.0 else last_move
        before, op = op, min(max(op + move, low), high)
        older_y, last_y, last_e = last_y, y, e
        gap, goes_on = op - stem, way * (op - before) > 0.0
        if gap > static or (goes_on and way > 0.0):
            stem, way = op - dynamic, slides
        elif gap < -static or (goes_on and way < 0.0):
            stem, way = op + dynamic, -slides
        else:
            way = 0.0
        x[k] = stem - rest
        out[0, k], out[1, k] = op, y
    return out
