"""Better settings for the running controller, and what they would do to this record.

PI settings of the largest integral gain whose sensitivity stays below a chosen Ms: for loads at
the process's entry the integrated error is Ti / Kc. The rule needs no form of the process.

Source: Astrom, Panagopoulos and Hagglund (1998), "Design of PI controllers based on non-convex
optimization", Automatica 34, 585-601. At Ms 1.6 it is as robust as SIMC with the closed-loop time
constant equal to the dead time (Skogestad 2003, Journal of Process Control 13, 291-309).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.controller import Controller
from estimator.diagnosis.linear_loop import LinearLoop
from estimator.diagnosis.simulation import disturbance_of, resimulate
from loop_model import ProcessModel, ValveModel

__all__ = ["Advice", "advise", "tune_pi"]

_ROBUSTNESS = 1.6
"""Ms of the proposed settings: SIMC's own is 1.59 for a lag with dead time."""
_GRID = np.geomspace(5e-4, 0.5, 400)
_TIMES = 40
_HALVINGS = 28


@dataclass(frozen=True, slots=True)
class Advice:
    """Proposed settings with what they do to this record; advice only, nothing is written.

    Attributes:
        controller: the proposed one.
        sensitivity: its Ms, and that of the running one.
        gain_margin, phase_margin_deg: of the proposed settings.
        integral_ratio: its integral gain over the running one's.
        deviation, running_deviation: standard deviation of the control error with the proposed
            and the running settings, both simulated with the record's own disturbance.
        travel, running_travel: OP's travel, likewise.
        note: what it cannot cure.
    """

    controller: Controller
    sensitivity: float
    running_sensitivity: float
    gain_margin: float
    phase_margin_deg: float
    integral_ratio: float
    deviation: float
    running_deviation: float
    travel: float
    running_travel: float
    note: str = ""

    @property
    def change(self) -> float:
        """Change of the error's standard deviation, as a share; negative is better."""
        return self.deviation / self.running_deviation - 1.0 if self.running_deviation else 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return the result in plain types."""
        return {
            "rule": "largest integral gain at the given Ms (Astrom, Panagopoulos, Hagglund 1998)",
            "structure": self.controller.structure,
            "gain": float(self.controller.gain),
            "integral_time_s": self.controller.integral_time_s,
            "derivative_time_s": 0.0,
            "ms": self.sensitivity,
            "running_ms": self.running_sensitivity,
            "gain_margin": self.gain_margin,
            "phase_margin_deg": self.phase_margin_deg,
            "integral_gain_ratio": self.integral_ratio,
            "predicted_error_std": self.deviation,
            "simulated_running_error_std": self.running_deviation,
            "predicted_change_of_error_std": self.change,
            "predicted_op_travel": self.travel,
            "simulated_running_op_travel": self.running_travel,
            "note": self.note,
        }


def tune_pi(
    process: ProcessModel, running: Controller, robustness: float = _ROBUSTNESS
) -> Controller | None:
    """PI settings of the largest integral gain at a sensitivity; None where there are none."""
    unit = replace(running, structure="PI", derivative_time_s=0.0, filter_time_s=0.0)
    probe = LinearLoop.of(process, replace(unit, gain=1.0, integral_rate=0.0))
    response = probe.process_response(_GRID)
    if not np.isfinite(response).all():
        return None
    side = math.copysign(1.0, sum(process.b))
    q = np.exp(-2j * math.pi * _GRID)
    best, found = 0.0, None
    for time in np.geomspace(0.7, 0.25 / _GRID[0], _TIMES):
        shape = side * response * (1.0 + 1.0 / (time * (1.0 - q)))
        gain = _largest_gain(shape, robustness)
        if gain is not None and gain / time > best:
            best, found = gain / time, (gain, time)
    if found is None:
        return None
    gain, time = found
    return replace(
        unit,
        gain=side * gain,
        integral_time_s=time * process.period,
        integral_rate=side * gain / time / process.period,
    )


def _largest_gain(shape: np.ndarray, robustness: float) -> float | None:
    """Largest gain up to which the sensitivity never exceeded ``robustness``."""
    scale = 1.0 / float(np.median(np.abs(shape)))
    gains = scale * np.geomspace(1e-4, 1e4, 120)
    peaks = np.max(1.0 / np.abs(1.0 + gains[:, None] * shape[None]), axis=1)
    # beyond the first crossing the loop is unstable and the peaks mean nothing
    over = np.flatnonzero(peaks > robustness)
    if over.size == 0 or over[0] == 0:
        return None
    low, high = float(gains[over[0] - 1]), float(gains[over[0]])
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        if np.max(1.0 / np.abs(1.0 + middle * shape)) > robustness:
            high = middle
        else:
            low = middle
    return low


def advise(
    process: ProcessModel,
    running: Controller,
    pv: Array,
    sp: Array,
    stem: Array,
    valve: ValveModel | None,
    limits: tuple[float, float],
) -> Advice | None:
    """Propose settings and simulate them on the record, with a sticky valve where there is one.

    Args:
        process, running: identified process and the controller read off.
        pv, sp, stem: the record without holes, ``(n,)``; ``stem`` is OP for a healthy valve.
        valve: the sticky valve, None for a healthy one.
        limits: of OP.
    """
    proposed = tune_pi(process, running)
    if proposed is None:
        return None
    loop, new = LinearLoop.of(process, running), LinearLoop.of(process, proposed)
    disturbance = disturbance_of(process, stem, pv)
    friction = (valve.static_friction, valve.dynamic_friction) if valve else (0.0, 0.0)
    figures = []
    for controller in (running, proposed):
        u, y = resimulate(process, controller, sp, disturbance, float(stem[0]), limits, friction)
        skip = u.size // 10
        figures.append((float(np.std((sp - y)[skip:])), float(np.abs(np.diff(u)).sum())))
    if not all(math.isfinite(v) and v < 1e12 for row in figures for v in row):
        return None
    margins = new.margins()
    rate = running.integral_rate
    return Advice(
        controller=proposed,
        sensitivity=margins.sensitivity,
        running_sensitivity=loop.margins().sensitivity,
        gain_margin=margins.gain,
        phase_margin_deg=margins.phase_deg,
        integral_ratio=proposed.integral_rate / rate if rate else math.inf,
        deviation=figures[1][0],
        running_deviation=figures[0][0],
        travel=figures[1][1],
        running_travel=figures[0][1],
        note="" if valve is None else _STICKY,
    )


_STICKY = (
    "The valve sticks: other settings change the size and the period of the cycle and do not end "
    "it. Repair the valve first."
)
