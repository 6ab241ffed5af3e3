"""Draws of valves, plants, controllers and loads: one loop before it is simulated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.families.report import loads
from benchmarks.families.report.closed_loop import Wiring
from benchmarks.families.report.kinds import Kind
from benchmarks.families.report.plants import NO_LOOP, Controller, Plant, tune
from benchmarks.families.report.valves import HEALTHY, LAWS, Valve, measure_by_ramp

__all__ = ["Scenario", "draw_scenario", "log_uniform"]

Array = NDArray[np.float64]
Rng = np.random.Generator

BANDS = (1.0, 12.0)
"""Stick bands, % of OP: from what a maintained valve shows to one ready for repair (own choice)."""

FORCE_LAWS = ("karnopp", "lugre")

FORCE_STEP = 0.02
"""Longest step of a force balance, seconds: a tenth of a stem's run."""

QUICK_STEPS = 6
"""Steps in a scan where no force balance is solved."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """All that a simulation needs but the noise, and what is true of the first valve."""

    plants: tuple[Plant, Plant]
    valves: tuple[Valve, Valve]
    controllers: tuple[Controller, Controller]
    wiring: Wiring
    period: float
    law: str
    stick_band: float
    slip_jump: float
    size: float
    """The stick band, or for a healthy valve what its loads are scaled by, % of OP."""
    pace: float
    """Time in which the loop answers, scans."""
    set_points: Array
    inflow: Array
    outflow: Array


def log_uniform(rng: Rng, low: float, high: float) -> float:
    """A number between ``low`` and ``high``, all orders of magnitude alike."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _draw_force_valve(rng: Rng, law: str, dt: float) -> tuple[Valve, float, float]:
    """A valve with a force balance that does slip, and what a ramp finds of it."""
    while True:
        band, share = log_uniform(rng, *BANDS), rng.uniform(0.2, 0.85)
        viscous = log_uniform(rng, 0.03, 0.15)
        valve = Valve(
            LAWS[law],
            static=band * (1.0 + share) / 2.0,
            dynamic=band * (1.0 - share) / 2.0,
            air_lag=log_uniform(rng, 0.15, 1.2),
            viscous=viscous,
            inertia=log_uniform(rng, 1e-5, 1e-3),
            stribeck=rng.uniform(0.08, 0.25) * band * share / viscous,
            stiffness=log_uniform(rng, 20.0, 150.0),
        )
        measured, jump = measure_by_ramp(valve, dt)
        if 0.5 * band < measured < 1.4 * band and jump > 0.05 * band:
            return valve, measured, jump


def _draw_valve(rng: Rng, kind: Kind, law: str, period: float) -> tuple[Valve, float, float]:
    if law in FORCE_LAWS:
        return _draw_force_valve(rng, law, period / _steps(law, period))
    band = log_uniform(rng, *BANDS)
    share = {"pure-slip": 1.0, "dead-band": 0.0}.get(kind.name, 0.05 + 0.95 * rng.beta(1.4, 1.6))
    jump = band * share
    air = period * rng.uniform(0.1, 1.0) if rng.random() < 0.4 else 0.0
    return Valve(LAWS[law], (band + jump) / 2.0, (band - jump) / 2.0, air), band, jump


def _steps(law: str, period: float) -> int:
    return max(QUICK_STEPS, int(np.ceil(period / FORCE_STEP))) if law in FORCE_LAWS else QUICK_STEPS


def _draw_plant(rng: Rng, kind: Kind) -> Plant:
    gain = float(rng.choice([1.0, 1.0, -1.0])) * log_uniform(rng, 0.2, 4.0)
    plant = Plant(
        gain=gain,
        dead_time=0.0,
        lag=0.0,
        second_lag=0.0,
        lead=0.0,
        frequency=0.0,
        damping=1.0,
        level=0.0,
        leak=0.0,
        sensor_lag=0.0,
        rangeability=1.0,
        choke=0.0,
        middle=rng.uniform(28.0, 72.0),
    )
    if kind.plant == "flow" or (kind.plant == "any" and rng.random() < 0.3):
        plant = plant._replace(
            lag=rng.uniform(0.1, 1.8), dead_time=float(rng.choice([0.0, 0.0, 0.5, 1.0, 2.0]))
        )
    elif kind.plant == "level" or (kind.plant == "any" and rng.random() < 0.12):
        plant = plant._replace(
            gain=gain * log_uniform(rng, 0.01, 0.1),
            level=1.0,
            leak=float(rng.choice([0.0, 0.0, log_uniform(rng, 1e-4, 3e-3)])),
            lag=rng.uniform(0.0, 3.0),
            dead_time=float(rng.choice([0.0, rng.uniform(0.0, 5.0)])),
        )
    elif kind.plant == "resonant":
        plant = plant._replace(
            frequency=log_uniform(rng, 0.05, 0.4),
            damping=rng.uniform(0.08, 0.45),
            dead_time=rng.uniform(0.0, 3.0),
        )
    else:
        lag = log_uniform(rng, 2.0, 30.0)
        plant = plant._replace(lag=lag, dead_time=lag * log_uniform(rng, 0.05, 1.2))
        if rng.random() < 0.5:
            second = lag * rng.uniform(0.1, 1.0)
            lead = second * rng.uniform(-1.0, 1.0) if rng.random() < 0.3 else 0.0
            plant = plant._replace(second_lag=second, lead=lead)
    if kind.name == "sensor-lag":
        plant = plant._replace(sensor_lag=log_uniform(rng, 3.0, 20.0))
    elif rng.random() < 0.4:
        plant = plant._replace(sensor_lag=rng.uniform(0.2, 1.5))
    if kind.name == "curved":
        plant = plant._replace(rangeability=rng.uniform(20.0, 50.0), choke=rng.uniform(0.0, 0.9))
    elif rng.random() < 0.3:
        plant = plant._replace(rangeability=rng.uniform(2.0, 8.0), choke=rng.uniform(0.0, 0.4))
    return plant


def _pace(plant: Plant, controller: Controller) -> float:
    own = plant.dead_time + 0.5 * controller.every + 0.3 * (plant.lag + plant.second_lag)
    if plant.frequency > 0.0:
        own += 1.0 / plant.frequency
    return own + plant.sensor_lag + 0.7 * controller.filter_lag


def _draw_controller(rng: Rng, kind: Kind, plant: Plant) -> Controller:
    every = int(rng.choice([1, 1, 1, 1, 2, 3]))
    raw = Controller(
        gain=1.0,
        integral=1.0,
        derivative=0.0,
        filter_lag=rng.uniform(0.5, 3.0) if rng.random() < 0.3 else 0.0,
        every=every,
        low=0.0,
        high=100.0,
        fastest=100.0 if rng.random() < 0.8 else rng.uniform(2.0, 10.0),
        gap=0.0,
        resolution=float(rng.choice([0.0, 0.0, 0.025, 0.1])),
    )
    pace = _pace(plant, raw)
    if plant.level > 0.0:
        integral = pace * log_uniform(rng, 6.0, 25.0)
    else:
        integral = (plant.lag + plant.second_lag + 0.5 * pace) * log_uniform(rng, 0.4, 1.8)
        integral = max(integral, 1.5 * every)
    raw = raw._replace(integral=integral)
    if plant.frequency == 0.0 and plant.lag > 3.0 and rng.random() < 0.25:
        raw = raw._replace(derivative=0.15 * pace)
    if kind.name == "tight-tuning":
        return tune(plant, raw, rng.uniform(1.03, 1.2), 3.0)
    lowest = 3.0 if kind.name == "interacting" else 1.9
    return tune(plant, raw, rng.uniform(lowest, 6.0), rng.uniform(25.0, 55.0))


def _outside(rng: Rng, shape: str, n: int, pace: float) -> Array:
    period = min(max(pace * log_uniform(rng, 6.0, 40.0), 10.0), 260.0)
    if shape == "sine":
        return loads.sine(rng, n, period)
    if shape == "triangle":
        return loads.triangle(rng, n, period)
    if shape == "sines":
        return loads.sines(rng, n, period)
    if shape == "load-steps":
        return loads.load_steps(rng, n, 2.0 * period)
    if shape == "ramps":
        return loads.ramps(rng, n, 1.5 * period)
    return loads.drift(rng, n)


def _draw_loads(rng: Rng, kind: Kind, s: Scenario, sticky: bool, n: int) -> Scenario:
    quiet = rng.uniform(0.02, 0.25) if sticky else rng.uniform(0.1, 0.5)
    if kind.name == "dead-band":
        quiet = rng.uniform(0.3, 0.8)
    elif not sticky and kind.load is None and kind.name not in ("interacting", "tight-tuning"):
        quiet = rng.uniform(0.4, 1.2)
    for i in range(2 if s.wiring.second else 1):
        s.inflow[i] = s.size * quiet * loads.coloured(rng, n, log_uniform(rng, 3.0, 200.0))
    shape = kind.load
    if shape is None and not sticky and rng.random() < 0.35:
        shape = str(rng.choice(["sine", "load-steps", "ramps", "drift"]))
    if kind.name == "few-strokes" and not sticky:
        shape = str(rng.choice(["sine", "sines", "load-steps", "triangle"]))
    if shape is not None:
        strength = log_uniform(rng, 0.3, 3.0) if sticky else log_uniform(rng, 0.5, 2.5)
        if shape == "drift":
            strength *= 2.5
        load = s.size * strength * _outside(rng, shape, n, s.pace)
        i = 1 if kind.name == "cascade" else 0
        if shape != "drift" and s.plants[0].level == 0.0 and rng.random() < 0.35:
            s.outflow[i] += s.plants[i].gain * load
        else:
            s.inflow[i] += load
    unit = abs(s.plants[0].gain) * (s.pace * 4.0 if s.plants[0].level else 1.0)
    if kind.name == "setpoint-steps" or (kind.name == "curved" and rng.random() < 0.5):
        strength = rng.uniform(0.5, 2.5)
        s.set_points[0] = unit * s.size * strength * loads.set_point_steps(rng, n, 25.0 * s.pace)
    return s


def _add_second_loop(rng: Rng, kind: Kind, s: Scenario, sticky: bool) -> Scenario:
    plant, controller = s.plants[0], s.controllers[0]
    if kind.name == "cascade":
        outer = plant._replace(
            gain=log_uniform(rng, 0.2, 3.0),
            lag=log_uniform(rng, 6.0, 40.0),
            dead_time=rng.uniform(2.0, 10.0) + controller.integral / 2.0,
            second_lag=0.0,
            rangeability=1.0,
            choke=0.0,
        )
        if rng.random() < 0.4:
            outer = outer._replace(gain=outer.gain * 0.03, level=1.0, lag=2.0)
        leading = _draw_controller(rng, kind, outer)
        wiring = s.wiring._replace(second=2, cascade_scale=plant.gain)
        return replace(
            s,
            plants=(plant, outer),
            controllers=(controller, leading),
            wiring=wiring,
            pace=_pace(outer, leading),
        )
    factor = log_uniform(rng, 0.5, 2.0)
    other = plant._replace(lag=plant.lag * factor, dead_time=plant.dead_time * factor)
    neighbour = tune(other, controller._replace(derivative=0.0), rng.uniform(2.5, 5.0), 40.0)
    joined = rng.uniform(0.25, 0.7), rng.choice([-1.0, 1.0]) * rng.uniform(0.0, 0.6)
    wiring = s.wiring._replace(second=1, to_first=joined[0], to_second=float(joined[1]))
    valve = HEALTHY
    if rng.random() < (0.15 if sticky else 0.75):
        band = s.size * log_uniform(rng, 0.5, 2.0)
        jump = band * rng.uniform(0.2, 1.0)
        law = LAWS[str(rng.choice(["he", "kano", "sliding"]))]
        valve = Valve(law, (band + jump) / 2.0, (band - jump) / 2.0)
    return replace(
        s,
        plants=(plant, other),
        valves=(s.valves[0], valve),
        controllers=(controller, neighbour),
        wiring=wiring,
    )


def draw_scenario(rng: Rng, kind: Kind, sticky: bool, n: int) -> Scenario:
    """A loop of ``kind`` with ``n`` scans of loads and set points."""
    law = str(rng.choice(kind.laws)) if sticky else "none"
    period = float(
        rng.choice([0.5, 1, 1, 2] if law in FORCE_LAWS else [1, 1, 2, 5, 10, 15, 30, 60])
    )
    valve, band, jump, size = HEALTHY, 0.0, 0.0, log_uniform(rng, *BANDS)
    if sticky:
        valve, band, jump = _draw_valve(rng, kind, law, period)
        size = band
    plant = _draw_plant(rng, kind)
    controller = _draw_controller(rng, kind, plant)
    scenario = Scenario(
        plants=(plant, NO_LOOP[0]),
        valves=(valve, HEALTHY),
        controllers=(controller, NO_LOOP[1]),
        wiring=Wiring(0, 0.0, 0.0, 0.0, _steps(law, period), period),
        period=period,
        law=law,
        stick_band=band,
        slip_jump=jump,
        size=size,
        pace=_pace(plant, controller),
        set_points=np.zeros((2, n)),
        inflow=np.zeros((2, n)),
        outflow=np.zeros((2, n)),
    )
    if kind.second:
        scenario = _add_second_loop(rng, kind, scenario, sticky)
    return _draw_loads(rng, kind, scenario, sticky, n)
