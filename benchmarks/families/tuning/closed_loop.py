"""The closed loop: PI or PID controllers at their scan, process and valve at inner steps.

One kernel runs a single loop, two loops that interact, or a cascade. Loop 0 is the recorded one;
in a cascade it is the inner loop, and loop 1 writes its set point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.families.tuning.linear_process import Process
from benchmarks.families.tuning.valves import LAWS, move_stem, valve_parameters, valve_state

__all__ = ["PV_REST", "Controller", "LoopPart", "Simulated", "Valve", "simulate"]

PV_REST = 50.0
"""PV at the operating point."""

INNER_STEPS = 8
"""Of process and valve per scan."""


@dataclass(frozen=True)
class Valve:
    """A valve law with its band and jump in percent of OP.

    `curvature` a bends the installed characteristic: flow = 100 (exp(a d / 100) - 1) / a for a stem
    d percent above mid-travel; ln 50 is equal percentage, a negative value quick opening, 0 linear.
    """

    law: str = "none"
    stick_band: float = 0.0
    slip_jump: float = 0.0
    pressure_lag: float = 0.15
    curvature: float = 0.0


@dataclass(frozen=True)
class Controller:
    """Velocity form, derivative on filtered PV; times in scans, gain in percent per PV unit."""

    gain: float
    integral_time: float
    derivative_time: float
    rest: float
    low: float = 0.0
    high: float = 100.0


@dataclass(frozen=True)
class LoopPart:
    """One loop of the simulation; `load` in percent of OP at the valve, `noise` in PV, per scan.

    Where `noise` is NaN the transmitter repeats its last value.
    """

    process: Process
    controller: Controller
    valve: Valve
    load: NDArray[np.float64]
    noise: NDArray[np.float64]


@dataclass(frozen=True)
class Simulated:
    """Signals of loop 0 at every scan."""

    op: NDArray[np.float64]
    pv: NDArray[np.float64]
    sp: NDArray[np.float64]
    stem: NDArray[np.float64]


@njit(cache=True)
def _flow(stem, curvature):  # type: ignore[no-untyped-def]
    if abs(curvature) < 1e-9:
        return stem - 50.0
    return 100.0 * (np.exp(curvature * (stem - 50.0) / 100.0) - 1.0) / curvature


@njit(cache=True)
def _quantise(value, quantum):  # type: ignore[no-untyped-def]
    return value if quantum <= 0.0 else np.round(value / quantum) * quantum


@njit(cache=True)
def _run(  # type: ignore[no-untyped-def]
    cascade, couple, transition, entry, gain, delay, law, valve, state, curve, control, sp, load,
    noise, quantum, inner,
):  # fmt: skip
    loops, scans = load.shape
    x = np.zeros((loops, 3))
    buffers = np.zeros((loops, delay.max() + 1))
    place = 0
    op = control[:, 3].copy()
    rest_flow = np.empty(loops)
    for i in range(loops):
        rest_flow[i] = _flow(op[i], curve[i])
    measured = np.zeros((loops, 2))
    error = np.zeros(loops)
    filtered = np.zeros((loops, 2))
    flow = np.zeros(loops)
    out = np.empty((4, scans))
    written_sp = np.empty(loops)
    for k in range(scans):
        for i in range(loops - 1, -1, -1):
            # a transmitter that froze repeats its last value
            if not np.isnan(noise[i, k]):
                measured[i, 0] = _quantise(x[i, 2] + noise[i, k], quantum[1])
            written_sp[i] = sp[i, k]
            if cascade and i == 0:
                # One percent of the outer OP moves the inner set point by the inner gain's size.
                written_sp[0] += (op[1] - control[1, 3]) * gain[0]
            now = written_sp[i] - measured[i, 0]
            change = control[i, 0] * (now - error[i] + now / control[i, 1])
            error[i] = now
            if control[i, 2] > 0.0:
                smooth = filtered[i, 0] + 0.5 * (measured[i, 0] - filtered[i, 0])
                slope = smooth - filtered[i, 0]
                change -= control[i, 0] * control[i, 2] * (slope - filtered[i, 1])
                filtered[i, 0] = smooth
                filtered[i, 1] = slope
            op[i] = min(max(op[i] + change, control[i, 4]), control[i, 5])
        sent = _quantise(op[0], quantum[0])
        out[0, k] = sent
        out[1, k] = measured[0, 0]
        out[2, k] = written_sp[0]
        for _ in range(inner):
            for i in range(loops):
                if not (cascade and i == 1):
                    move_stem(law[i], state[i], sent if i == 0 else op[i], valve[i], inner)
                    flow[i] = _flow(state[i, 0], curve[i]) - rest_flow[i] + load[i, k]
            for i in range(loops):
                drive = flow[i]
                if cascade and i == 1:
                    drive = x[0, 1] / gain[0] + load[1, k]
                elif loops == 2 and not cascade:
                    drive += couple[i] * flow[1 - i]
                buffers[i, place % (delay[i] + 1)] = drive
                drive = gain[i] * buffers[i, (place + 1) % (delay[i] + 1)]
                a, b, c = x[i, 0], x[i, 1], x[i, 2]
                for r in range(3):
                    x[i, r] = (
                        transition[i, r, 0] * a
                        + transition[i, r, 1] * b
                        + transition[i, r, 2] * c
                        + entry[i, r] * drive
                    )
            place += 1
        out[3, k] = state[0, 0]
    return out


def simulate(
    parts: tuple[LoopPart, ...],
    sp: NDArray[np.float64],
    *,
    cascade: bool = False,
    coupling: tuple[float, float] = (0.0, 0.0),
    quantum: tuple[float, float] = (0.0, 0.0),
) -> Simulated:
    """Run one loop or two.

    Args:
        parts: the recorded loop first.
        sp: (scans,) deviation of the recorded loop's set point; the outer one's in a cascade.
        cascade: part 1 is the outer controller and its process.
        coupling: share of the other valve's flow that enters loop 0 and loop 1.
        quantum: resolution of the analogue output in percent and of the input in PV; 0 for none.
    """
    discrete = [part.process.discretise(INNER_STEPS) for part in parts]
    controls = [part.controller for part in parts]
    set_points = np.zeros((len(parts), len(sp)))
    set_points[1 if cascade else 0] = sp
    values = [
        valve_parameters(p.valve.stick_band, p.valve.slip_jump, p.valve.pressure_lag) for p in parts
    ]
    out = _run(
        cascade,
        np.array(coupling),
        np.array([d[0] for d in discrete]),
        np.array([d[1] for d in discrete]),
        np.array([p.process.gain for p in parts]),
        np.array([round(p.process.dead_time * INNER_STEPS) for p in parts]),
        np.array([LAWS.index(p.valve.law) for p in parts]),
        np.array(values),
        np.array(
            [valve_state(p.controller.rest, v[1]) for p, v in zip(parts, values, strict=True)]
        ),
        np.array([p.valve.curvature for p in parts]),
        np.array(
            [[c.gain, c.integral_time, c.derivative_time, c.rest, c.low, c.high] for c in controls]
        ),
        set_points,
        np.array([p.load for p in parts]),
        np.array([p.noise for p in parts]),
        np.array(quantum),
        INNER_STEPS,
    )
    return Simulated(op=out[0], pv=PV_REST + out[1], sp=PV_REST + out[2], stem=out[3])
