"""Processes and controllers of the report family. Time is counted in scans of the controller."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled import kernel

__all__ = ["NO_LOOP", "PLANT_STATES", "Controller", "Plant", "step_plant", "tune", "valve_flow"]

Array = NDArray[np.float64]

PLANT_STATES = 6
"""Values in a plant's memory: lag, second stage, its rate, level, sensor, last output."""


class Plant(NamedTuple):
    """Valve characteristic, dead time, two stages, a level and a sensor in series."""

    gain: float
    """PV per OP; per OP and scan for a level."""
    dead_time: float
    lag: float
    second_lag: float
    lead: float
    """Zero of the second stage; negative is an inverse response."""
    frequency: float
    """Natural frequency of an under-damped second stage, rad per scan; 0 for two lags."""
    damping: float
    level: float
    """1 for an integrating process, else 0."""
    leak: float
    """Self-regulation of the level per scan."""
    sensor_lag: float
    rangeability: float
    """Of the equal-percentage trim; 1 is linear."""
    choke: float
    """How much the pressure drop falls with flow, 0 to 1: bends the characteristic back."""
    middle: float
    """OP at which the process is at rest."""


class Controller(NamedTuple):
    """PI(D) in velocity form with a clamp, as most control systems run it."""

    gain: float
    """OP per PV, with the sign that makes the loop stable."""
    integral: float
    """Integral time, scans."""
    derivative: float
    filter_lag: float
    every: int
    """Scans between two executions."""
    low: float
    high: float
    fastest: float
    """Largest change of OP in one execution."""
    gap: float
    """Error below which the gain is a fifth; 0 for none."""
    resolution: float
    """Smallest step of the output card, OP units."""


NO_LOOP = (
    Plant(1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 50.0),
    Controller(0.0, 1.0, 0.0, 0.0, 1, 0.0, 100.0, 100.0, 0.0, 0.0),
)
"""Plant and controller where a second loop is not wanted."""


@kernel
def _installed(plant: Plant, x: float) -> float:
    opening = min(max(x, 0.0), 100.0) / 100.0
    area = opening
    if plant.rangeability > 1.0:
        area = plant.rangeability ** (opening - 1.0)
    return area / math.sqrt(1.0 - plant.choke + plant.choke * area * area)


@kernel
def valve_flow(plant: Plant, x: float) -> float:
    """Flow through the installed valve as a deviation, of slope 1 at the plant's middle."""
    if plant.rangeability <= 1.0 and plant.choke <= 0.0:
        return min(max(x, 0.0), 100.0) - plant.middle
    slope = (_installed(plant, plant.middle + 0.5) - _installed(plant, plant.middle - 0.5)) / 1.0
    return (_installed(plant, x) - _installed(plant, plant.middle)) / slope


@kernel
def step_plant(plant: Plant, state: Array, inflow: float, load: float, dt: float) -> float:
    """Move the plant by ``dt`` under the (already delayed) ``inflow``; its measured output."""
    if plant.lag > 0.0:
        state[0] += (inflow - state[0]) * (1.0 - math.exp(-dt / plant.lag))
    else:
        state[0] = inflow
    out = state[0]
    if plant.frequency > 0.0:
        w = plant.frequency
        state[2] += dt * (w * w * (state[0] - state[1]) - 2.0 * plant.damping * w * state[2])
        state[1] += dt * state[2]
        out = state[1]
    elif plant.second_lag > 0.0:
        rate = (state[0] - state[1]) / plant.second_lag
        state[1] += (state[0] - state[1]) * (1.0 - math.exp(-dt / plant.second_lag))
        out = state[1] + plant.lead * rate
    if plant.level > 0.0:
        state[3] += dt * (out - plant.leak * state[3])
        out = state[3]
    true = plant.gain * out + load
    if plant.sensor_lag > 0.0:
        state[4] += (true - state[4]) * (1.0 - math.exp(-dt / plant.sensor_lag))
    else:
        state[4] = true
    state[5] = true
    return float(state[4])


def _response(plant: Plant, w: Array) -> NDArray[np.complex128]:
    s = 1j * w
    g = plant.gain * np.exp(-s * plant.dead_time) / (1.0 + s * plant.lag)
    if plant.frequency > 0.0:
        wn = plant.frequency
        g = g * wn**2 / (s**2 + 2.0 * plant.damping * wn * s + wn**2)
    elif plant.second_lag > 0.0:
        g = g * (1.0 + plant.lead * s) / (1.0 + plant.second_lag * s)
    if plant.level > 0.0:
        g = g / (s + plant.leak)
    return np.asarray(g / (1.0 + s * plant.sensor_lag), dtype=np.complex128)


def tune(
    plant: Plant, controller: Controller, gain_margin: float, phase_margin: float
) -> Controller:
    """``controller`` with the gain for ``gain_margin``, made slower until ``phase_margin`` holds.

    Margins are those of the linear loop with half an execution of delay for the sampling;
    ``phase_margin`` is in degrees. Only |gain| and the integral time change.
    """
    w = np.logspace(-4.0, np.log10(np.pi / controller.every), 600)
    s = 1j * w
    process = np.abs(plant.gain) / plant.gain * _response(plant, w)
    process = process * np.exp(-s * 0.5 * controller.every) / (1.0 + s * controller.filter_lag)
    integral = controller.integral
    for _ in range(16):
        law = 1.0 + 1.0 / (s * integral) + s * controller.derivative / (1.0 + s)
        loop = process * law
        phase = np.unwrap(np.angle(loop))
        phase = phase - 2.0 * np.pi * np.round((phase[0] + 0.5 * np.pi) / (2.0 * np.pi))
        beyond = (phase < -np.pi) & (w * integral > 1.0)
        strongest = np.abs(loop)[beyond].max() if beyond.any() else 0.5 * np.abs(loop[-1])
        gain = 1.0 / (gain_margin * float(strongest))
        above = gain * np.abs(loop) > 1.0
        crossings = np.flatnonzero(above[:-1] & ~above[1:])
        margin = 180.0 + np.degrees(phase[crossings].min()) if crossings.size else 90.0
        if margin >= phase_margin:
            break
        integral *= 1.15
        gain_margin *= 1.08
    return controller._replace(gain=float(gain * np.sign(plant.gain)), integral=float(integral))
