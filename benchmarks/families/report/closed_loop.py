"""One or two control loops with their valves, simulated scan by scan.

Two loops either interact (each valve's flow reaches the other's PV) or form a cascade (the second
controller's output is the first one's set point). The first loop is the one that is recorded.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.families.report.plants import (
    PLANT_STATES,
    Controller,
    Plant,
    step_plant,
    valve_flow,
)
from benchmarks.families.report.valves import STATES, Valve, move_stem, start_stem
from compiled import kernel

__all__ = ["Wiring", "simulate"]

Array = NDArray[np.float64]


class Wiring(NamedTuple):
    """How two loops are joined, and how finely they are simulated."""

    second: int
    """0: one loop; 1: they interact; 2: the second controller leads the first (cascade)."""
    to_first: float
    """Share of the second valve's flow that reaches the first PV."""
    to_second: float
    cascade_scale: float
    """First set point per OP of the leading controller."""
    steps: int
    """Steps of the valve and process in one scan."""
    valve_seconds: float
    """Length of a scan in the valves' unit of time."""
    lowest: float = -np.inf
    """Least PV that the first loop's transmitter can send."""
    highest: float = np.inf


@kernel
def _control(c: Controller, memory: Array, sp: float, pv: float) -> float:
    """One execution; memory: OP, last error, filtered PV, last and last but one filtered PV."""
    if c.filter_lag > 0.0:
        memory[2] += (pv - memory[2]) * (1.0 - np.exp(-c.every / c.filter_lag))
    else:
        memory[2] = pv
    error = sp - memory[2]
    gain = c.gain
    if abs(error) < c.gap:
        gain *= 0.2
    change = gain * (error - memory[1] + c.every * error / c.integral)
    if c.derivative > 0.0:
        bend = memory[2] - 2.0 * memory[3] + memory[4]
        change -= gain * c.derivative * bend / c.every
    memory[4] = memory[3]
    memory[3] = memory[2]
    memory[1] = error
    change = min(max(change, -c.fastest), c.fastest)
    memory[0] = min(max(memory[0] + change, c.low), c.high)
    return float(memory[0])


@kernel
def _card(c: Controller, op: float) -> float:
    if c.resolution > 0.0:
        return float(np.round(op / c.resolution) * c.resolution)
    return op


@kernel
def simulate(
    plants: tuple[Plant, Plant],
    valves: tuple[Valve, Valve],
    controllers: tuple[Controller, Controller],
    wiring: Wiring,
    set_points: Array,
    inflow: Array,
    outflow: Array,
    noise: Array,
) -> tuple[Array, Array, Array, Array]:
    """OP, PV, set point and stem of the first loop, shape ``(n,)`` each.

    ``set_points``, ``inflow`` (load beside the valve's flow, OP units), ``outflow`` (load on PV)
    and ``noise`` (of measurement, seen by the controller) have shape ``(2, n)``. Where the first
    loop's noise is NaN its transmitter repeats the last value.
    """
    n = set_points.shape[1]
    ops, pvs, sps, stems = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    loops = 2 if wiring.second > 0 else 1
    stem = np.zeros((2, STATES))
    state = np.zeros((2, PLANT_STATES))
    memory = np.zeros((2, 5))
    op, flow = np.zeros(2), np.zeros(2)
    dt = 1.0 / wiring.steps
    longest = 1 + int(max(plants[0].dead_time, plants[1].dead_time) * wiring.steps + 0.5)
    pipe = np.zeros((2, longest))
    back_0 = int(plants[0].dead_time * wiring.steps + 0.5)
    back_1 = int(plants[1].dead_time * wiring.steps + 0.5)
    memory[0, 0] = plants[0].middle
    memory[1, 0] = plants[1].middle
    for i in range(2):
        start_stem(stem[i], memory[i, 0])
    at = 0
    pv_0 = 0.0
    for k in range(n):
        if k == 0 or not np.isnan(noise[0, k]):
            pv_0 = min(max(state[0, 4] + noise[0, k], wiring.lowest), wiring.highest)
        pv_1 = state[1, 4] + noise[1, k]
        sp = set_points[0, k]
        if loops == 2 and k % controllers[1].every == 0:
            _control(controllers[1], memory[1], set_points[1, k], pv_1)
        if wiring.second == 2:
            sp += wiring.cascade_scale * (memory[1, 0] - plants[1].middle)
        if k % controllers[0].every == 0:
            _control(controllers[0], memory[0], sp, pv_0)
        op[0] = _card(controllers[0], memory[0, 0])
        op[1] = _card(controllers[1], memory[1, 0])
        ops[k], pvs[k], sps[k] = memory[0, 0], pv_0, sp
        later = min(k + 1, n - 1)
        for j in range(wiring.steps):
            part = (j + 1.0) * dt
            x_0 = move_stem(valves[0], stem[0], op[0], dt * wiring.valve_seconds)
            flow[0] = valve_flow(plants[0], x_0)
            if wiring.second == 1:
                x_1 = move_stem(valves[1], stem[1], op[1], dt * wiring.valve_seconds)
                flow[1] = valve_flow(plants[1], x_1)
            elif wiring.second == 2:
                flow[1] = state[0, 5] / plants[0].gain
            in_0 = flow[0] + wiring.to_first * flow[1] * (wiring.second == 1)
            in_0 += inflow[0, k] + part * (inflow[0, later] - inflow[0, k])
            pipe[0, at] = in_0
            load = outflow[0, k] + part * (outflow[0, later] - outflow[0, k])
            step_plant(plants[0], state[0], pipe[0, (at - back_0) % longest], load, dt)
            if loops == 2:
                in_1 = flow[1] + wiring.to_second * flow[0] * (wiring.second == 1)
                in_1 += inflow[1, k] + part * (inflow[1, later] - inflow[1, k])
                pipe[1, at] = in_1
                load = outflow[1, k] + part * (outflow[1, later] - outflow[1, k])
                step_plant(plants[1], state[1], pipe[1, (at - back_1) % longest], load, dt)
            at = (at + 1) % longest
        stems[k] = stem[0, 0]
    return ops, pvs, sps, stems
