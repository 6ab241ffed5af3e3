"""What is simulated for a kind of loop: process, tuning, valve, disturbances, a second loop."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.families.tuning.closed_loop import (
    Controller,
    LoopPart,
    Simulated,
    Valve,
    simulate,
)
from benchmarks.families.tuning.linear_process import Process, tune
from benchmarks.families.tuning.loads import Floats, colour, disturb

__all__ = ["Scene", "draw_scene", "log_uniform"]

SHORTEST_WINDOW, LONGEST_WINDOW = 500, 1500
"""Samples of a record."""

LONGEST_PHYSICAL_WINDOW = 900
"""Samples; the fine steps of physical friction make a draw slow."""


@dataclass(frozen=True)
class Scene:
    """All that is simulated, before noise."""

    parts: tuple[LoopPart, ...]
    sp: Floats
    warm: int
    samples: int
    every: int
    cascade: bool = False
    coupling: tuple[float, float] = (0.0, 0.0)
    quantum: tuple[float, float] = (0.0, 0.0)

    def run(self, part: LoopPart | None = None) -> Simulated:
        """Return the signals after the warm-up; a second loop is recorded too, if given."""
        parts = self.parts if part is None else (part, *self.parts[1:])
        whole = simulate(
            parts, self.sp, cascade=self.cascade, coupling=self.coupling, quantum=self.quantum
        )
        keep = slice(self.warm, None)
        return Simulated(whole.op[keep], whole.pv[keep], whole.sp[keep], whole.stem[keep])


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform between those of `low` and `high`."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _draw_valve(kind: str, sticky: bool, rng: np.random.Generator) -> Valve:
    curvature = rng.uniform(1.0, 3.5) * rng.choice([-1.0, 1.0]) if kind == "curved" else 0.0
    band = log_uniform(rng, 2.0, 20.0)
    jump = {"pure-slip": band, "dead-band": 0.0}.get(kind, band * rng.uniform(0.12, 1.0))
    laws, shares = ("he", "kano", "sliding", "karnopp", "lugre"), (0.3, 0.22, 0.22, 0.13, 0.13)
    law = kind if kind in laws else str(rng.choice(laws, p=shares))
    if kind in ("decimated", "pure-slip", "dead-band") and law in ("karnopp", "lugre"):
        # Many scans per sample cost too much, and the physical laws reach these limits only nearly.
        law = "sliding" if kind != "pure-slip" else "he"
    # Bristles see the pressure's speed: an actuator slower than the scan smooths OP's steps.
    lag = rng.uniform(0.5, 1.0) if law == "lugre" else rng.uniform(0.05, 0.4)
    if not sticky:
        return Valve(curvature=curvature)
    return Valve(law, band, jump, lag, curvature)


def _draw_process(kind: str, every: int, rng: np.random.Generator) -> Process:
    form = "lags"
    level_share = 0.7 if kind == "dead-band" else 0.2
    if kind in ("integrating", "oscillatory"):
        form = kind
    elif kind not in ("pi", "cascade", "sensor-lag") and rng.uniform() < level_share:
        form = "integrating"
    low, high = (12.0, 50.0) if kind == "few-strokes" else (3.0, 40.0)
    lag = log_uniform(rng, low, high)
    second = lag * rng.uniform(0.05, 0.4) if rng.uniform() < 0.6 else 0.0
    dead = log_uniform(rng, 0.2, 8.0)
    if form == "integrating":
        lag, second = log_uniform(rng, 10.0, 100.0), rng.uniform(0.0, 4.0)
    if form == "oscillatory":
        lag, second, dead = log_uniform(rng, 2.0, 10.0), rng.uniform(0.15, 0.6), min(dead, 3.0)
    if kind == "cascade":
        lag, second, dead = log_uniform(rng, 1.0, 5.0), 0.0, rng.uniform(0.1, 1.0)
    sensor = lag * rng.uniform(0.4, 1.2) if kind == "sensor-lag" else rng.uniform(0.0, 0.8)
    gain = log_uniform(rng, 0.3, 3.0) * rng.choice([-1.0, 1.0])
    if every > 1:
        stretch = every * rng.uniform(0.3, 1.0)
        lag, dead = lag * stretch, dead * stretch
        second *= stretch if form != "oscillatory" else 1.0
    return Process(form, float(gain), lag, second, float(sensor), dead)


def _draw_part(
    kind: str, process: Process, valve: Valve, rng: np.random.Generator, scans: int
) -> LoopPart:
    """Tune `process` and give it the small coloured load that every loop has."""
    derivative = rng.uniform(0.2, 0.5) if kind == "noisy-op" or rng.uniform() < 0.2 else 0.0
    if process.form == "oscillatory":
        derivative = 0.0
    tight = kind == "tight-tuning"
    margin = rng.uniform(1.02, 1.2) if tight else rng.uniform(1.8, 3.0)
    gain, integral, rate = tune(
        process, log_uniform(rng, 0.7, 3.5), derivative, margin, exact=tight
    )
    share = log_uniform(rng, 0.01, 0.15)
    size = share * valve.stick_band if valve.stick_band else 8.0 * share
    load = colour(rng, scans, size, log_uniform(rng, 3.0, 100.0))
    rest = rng.uniform(35.0, 65.0)
    return LoopPart(process, Controller(gain, integral, rate, rest), valve, load, np.zeros(scans))


def _closed_loop_time(part: LoopPart) -> float:
    """Rough closed-loop time constant in scans, where disturbances hurt."""
    process = part.process
    wait = process.dead_time + 0.5 + process.sensor_lag
    return 2.0 * wait + 0.3 * min(process.lag, 60.0)


def draw_scene(kind: str, sticky: bool, rng: np.random.Generator) -> Scene:
    """Draw everything but noise and record."""
    samples = int(rng.integers(SHORTEST_WINDOW, LONGEST_WINDOW + 1))
    every = int(rng.integers(3, 11)) if kind == "decimated" else 1
    if kind == "few-strokes":
        samples = LONGEST_WINDOW
    valve = _draw_valve(kind, sticky, rng)
    process = _draw_process(kind, every, rng)
    longest_warm = 1500.0
    if valve.law in ("karnopp", "lugre") and kind != "few-strokes":
        samples, longest_warm = min(samples, LONGEST_PHYSICAL_WINDOW), 300.0
    warm = int(min(longest_warm, 200.0 + 8.0 * process.lag))
    scans = warm + samples * every
    part = _draw_part(kind, process, valve, rng, scans)
    size = valve.stick_band * rng.uniform(0.3, 1.8) if sticky else log_uniform(rng, 1.5, 12.0)
    size = min(size, 14.0)
    scale = _closed_loop_time(part)
    load = part.load + disturb(kind, rng, scans, size, scale)
    if kind == "dead-band" and rng.uniform() < 0.5:
        load += colour(rng, scans, 0.5 * valve.stick_band, rng.uniform(20.0, 80.0))
    if kind == "saturation" and sticky:
        load += disturb(kind, rng, scans, valve.stick_band, scale)
    if kind == "few-strokes" and not sticky:
        k = np.arange(scans)
        load += size * np.sin(2.0 * np.pi * (k / rng.uniform(150.0, 350.0) + rng.uniform()))
    if not sticky and kind in (
        "held",
        "interpolated",
        "quantised",
        "missing",
        "curved",
        "decimated",
    ):
        # Something to record: half of these oscillate from outside.
        load += disturb(
            str(rng.choice(["pi", "sine", "load-steps", "drift"])), rng, scans, size, scale
        )
    sp = np.zeros(scans)
    if kind == "setpoint-steps":
        sp = abs(process.gain) * disturb("load-steps", rng, scans, max(size, 2.0), scale)
    part = replace(part, load=load)
    scene = Scene((part,), sp, warm, samples, every)
    if kind == "interacting":
        other_sticks = rng.uniform() < (0.3 if sticky else 0.7)
        near = _draw_process("pi", 1, rng)
        beside = _draw_part("pi", near, _draw_valve("pi", other_sticks, rng), rng, scans)
        coupling = (rng.uniform(0.2, 0.7), rng.uniform(0.0, 0.5) * rng.choice([-1.0, 1.0]))
        scene = replace(scene, parts=(part, beside), coupling=coupling)
    if kind == "cascade":
        slow = _draw_process(str(rng.choice(["pi", "integrating"])), 1, rng)
        slow = replace(
            slow, lag=max(slow.lag, 15.0), dead_time=slow.dead_time + 4.0 + 2.0 * process.lag
        )
        outer = _draw_part("cascade", slow, Valve(), rng, scans)
        size = rng.uniform(0.0, 6.0)
        outer = replace(outer, load=outer.load + disturb("load-steps", rng, scans, size, scale))
        # The inner loop answers with its own delay; the tuning above allowed for it.
        outer = replace(
            outer, process=replace(slow, dead_time=slow.dead_time - 4.0 - 2.0 * process.lag)
        )
        scene = replace(scene, parts=(part, outer), cascade=True)
    return scene
