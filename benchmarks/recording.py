"""A window of a random loop: the closed loop is run, its last samples are what a historian has."""

from __future__ import annotations

import math
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.loops import Loop
from benchmarks.plants import REST, open_loop_plant, process_of
from compensator.action import Controller
from compensator.conventional.pi import PiController, PiSettings
from compensator.conventional.unaware import UnawareMpc
from loop_model import ProcessModel

__all__ = ["Recording", "record"]

Array = NDArray[np.float64]

_SETTLE = 300
_TRACE = 0.0025
_EDGE = 0.995
"""Of a badly tuned loop: share of its amplitude that the slowest mode keeps each sample."""
_SOUND = 0.95
"""Of any other: it keeps less, unless the integral part is slower than that."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A window of a loop: OP, PV, SP and stem, shape ``(n,)``.

    ``turns`` counts the turns of the stem in the same window of the loop with hardly any
    noise and no disturbance: with fewer than four the valve's cycle is not in the window.
    """

    op: Array
    pv: Array
    sp: Array
    stem: Array
    turns: int


def _controller(loop: Loop) -> Controller:
    """SIMC-tuned PI (Skogestad, 2003), or the MPC that knows the process."""
    process = process_of(loop)
    if loop.controller == "MPC":
        return UnawareMpc(process)
    constant = loop.time_constant
    second = {"second order": 0.25 * constant, "heat": 0.125 * constant}.get(loop.plant, 0.0)
    delay = loop.dead_time + 0.5 + second
    closed = max(delay, 0.7 * constant)
    reset = 4.0 * (closed + delay)
    if process.is_integrating:
        gain = 1.0 / (process.b[0] * (closed + delay))
    else:
        gain = constant / (closed + delay) / process.gain
        reset = min(constant, reset)
    if loop.trouble == "tuning":
        gain *= _factor(process, gain, reset, _EDGE)
    else:
        gain *= min(loop.aggressive, _factor(process, gain, reset, _SOUND))
    return PiController(PiSettings(gain=gain, integral_time=reset))


def _factor(process: ProcessModel, gain: float, reset: float, radius: float) -> float:
    """What the gain can be multiplied by until the loop's slowest mode is ``radius`` a sample."""
    difference = np.array([1.0, -1.0])
    delayed = np.concatenate([np.zeros(process.dead_time), process.b])
    through = gain * np.convolve(delayed, [1.0 + 1.0 / reset, -1.0])
    open_loop = np.convolve(np.concatenate([[1.0], process.a]), difference)
    size = max(through.size, open_loop.size)
    through = np.pad(through, (0, size - through.size))
    open_loop = np.pad(open_loop, (0, size - open_loop.size))

    def slowest(factor: float) -> float:
        return float(np.abs(np.roots(open_loop + factor * through)).max())

    # From the high side: a small gain has a slow mode too, that of its integral part.
    factor = 0.25
    while slowest(factor * 1.05) < max(radius, slowest(0.25)):
        factor *= 1.05
    return factor


def _load(loop: Loop, samples: int, rng: np.random.Generator) -> Array:
    """Load disturbance, in percent of OP."""
    scale = max(loop.stick_band, 2.0)
    load = np.zeros(samples)
    if loop.noise_kind == "drift":
        shocks = rng.normal(0.0, math.sqrt(1.0 - 0.995**2), samples)
        for k in range(1, samples):
            load[k] = 0.995 * load[k - 1] + shocks[k]
        load *= scale * loop.disturbance
    elif loop.noise_kind == "load steps":
        for at in rng.integers(_SETTLE, samples, 4):
            load[at:] += rng.choice([-1.0, 1.0]) * scale * loop.disturbance
    if loop.trouble == "outside":
        period = rng.uniform(20.0, 100.0)
        load += rng.uniform(1.0, 4.0) * np.sin(2.0 * np.pi * np.arange(samples) / period)
    return load


def _run(loop: Loop, sp: Array, load: Array, noise: Array) -> tuple[Array, Array, Array]:
    """OP, PV and stem of the closed loop."""
    op, pv, stem = np.empty(sp.size), np.empty(sp.size), np.empty(sp.size)
    controller = _controller(loop)
    applied = REST
    with ExitStack() as keep:
        plant = open_loop_plant(loop, keep)
        for k in range(sp.size):
            pv[k] = plant.pv + noise[k]
            controller.observe(float(pv[k]), applied)
            applied = controller.decide(float(sp[k])).op
            plant.step(applied, 0.0, float(load[k]))
            op[k], stem[k] = applied, plant.stem
    return op, pv, stem


def _turns(stem: Array, least: float) -> int:
    """Turns of the stem between ways of more than ``least``: creep in the packing is none."""
    turns, direction, furthest = 0, 0.0, float(stem[0])
    for value in stem.tolist():
        way = value - furthest
        if direction * way > 0.0:
            furthest = value
        elif abs(way) > least:
            turns += direction != 0.0
            direction, furthest = math.copysign(1.0, way), value
    return turns


def record(loop: Loop, *, samples: int = 1000) -> Recording:
    """Run the loop and return its last ``samples``.

    It runs twice: the first run, with hardly any noise, gives the swing that scales the noise.
    """
    total = _SETTLE + samples
    window = slice(_SETTLE, total)
    rng = np.random.default_rng([loop.seed, int(loop.is_healthy), 7])
    process = process_of(loop)
    # PV that an OP of one percent makes: an integrating process makes a fifth in a time constant.
    unit = 0.2 if process.is_integrating else process.gain
    size = 2.0 * max(loop.stick_band, 1.0) * unit
    sp = np.zeros(total)
    sp[50:] = size
    if rng.random() < 0.3:
        sp[_SETTLE + int(rng.integers(100, samples - 100)) :] = 0.0
    white = rng.normal(size=total)
    # A trace of noise, so that no loop comes to rest because its stem happens to stop on target.
    _, clean_pv, clean_stem = _run(loop, sp, np.zeros(total), _TRACE * size * white)
    swing = 0.5 * unit
    if not loop.is_healthy:
        swing = max(float((clean_pv - sp)[window].std()), 0.02 * loop.stick_band * unit)
    op, pv, stem = _run(loop, sp, _load(loop, total, rng), loop.noise * swing * white)
    return Recording(
        op[window],
        pv[window],
        sp[window],
        stem[window],
        _turns(clean_stem[window], 0.1 * loop.stick_band),
    )
