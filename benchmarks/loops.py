"""Random closed loops with a known valve: what `robustness` judges the estimator by.

A loop is drawn from its seed alone: process, controller, sampling, valve, noise and disturbances.
Gains are about one PV unit per percent of OP, so that percent of OP is a measure for both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.examples import sampled
from compensator.action import Controller
from compensator.pi import PiController, PiSettings
from compensator.study import StemLaw, Study, run
from compensator.unaware import UnawareMpc
from estimator.valves import ChoudhuryValve, HeValve, KanoValve, SlipStickValve
from loop_model import ProcessModel

__all__ = ["KarnoppValve", "Loop", "Recording", "draw_loop", "record"]

Array = NDArray[np.float64]

PROCESSES = ("first order", "second order", "dead time", "integrating")
PHYSICS = ("He", "Kano", "Choudhury", "Karnopp")
NOISES = ("white", "drift", "load steps")
_REST = 50.0
_SETTLE = 300


@dataclass(frozen=True, slots=True)
class Loop:
    """A loop with everything that was drawn for it.

    ``stick_band`` 0 is a healthy valve. ``noise`` is the standard deviation of PV's white noise as
    a share of that of PV's own cycle (of 0.5 % when healthy), ``disturbance`` the size of the
    load's changes as a share of the stick band (of 2 % of OP when smaller). ``sampling`` is the
    period over the process' time constant. ``trouble`` is what a healthy loop may oscillate from.
    """

    seed: int
    process: str
    controller: str
    physics: str
    noise_kind: str
    stick_band: float
    slip_jump: float
    noise: float
    disturbance: float
    sampling: float
    dead_time: int
    aggressive: float
    trouble: str

    @property
    def is_healthy(self) -> bool:
        """Whether there is nothing to find."""
        return self.stick_band == 0.0

    @property
    def is_moderate(self) -> bool:
        """Noise that a technician would call moderate: white, at most 15 % of the cycle."""
        return self.noise <= 0.15 and self.noise_kind == "white"


def draw_loop(seed: int, *, healthy: bool) -> Loop:
    """The loop of a seed."""
    rng = np.random.default_rng([seed, int(healthy)])
    process = str(rng.choice(PROCESSES))
    stick_band = float(np.exp(rng.uniform(np.log(0.5), np.log(10.0))))
    slip_jump = stick_band * float(rng.uniform(0.05, 1.0))
    sampling = float(np.exp(rng.uniform(np.log(0.05), np.log(1.0))))
    loop = Loop(
        seed=seed,
        process=process,
        controller=str(rng.choice(["PI", "PI", "MPC"])),
        physics=str(rng.choice(PHYSICS)),
        noise_kind=str(rng.choice(NOISES, p=[0.6, 0.2, 0.2])),
        stick_band=stick_band,
        slip_jump=slip_jump,
        noise=float(rng.uniform(0.02, 0.3)),
        disturbance=float(rng.uniform(0.05, 0.4)),
        sampling=sampling,
        dead_time=max(1, round(rng.uniform(0.3, 1.5) / sampling)) if process == "dead time" else 0,
        aggressive=float(rng.uniform(0.7, 1.5)),
        trouble=str(rng.choice(["none", "outside", "tuning"])),
    )
    if healthy:
        return replace(loop, stick_band=0.0, slip_jump=0.0, physics="healthy")
    return replace(loop, trouble="none")


def _process(loop: Loop) -> ProcessModel:
    constant = 1.0 / loop.sampling
    if loop.process == "integrating":
        slope = 0.2 * loop.sampling
        return ProcessModel((-1.0,), (slope,), 1, -slope * _REST, 1.0)
    lags = (constant, 0.5 * constant) if loop.process == "second order" else (constant,)
    model = sampled(*lags)
    return replace(
        model, dead_time=1 + loop.dead_time, offset=-_REST * model.gain * (1.0 + sum(model.a))
    )


def _controller(loop: Loop, process: ProcessModel) -> Controller:
    """SIMC-tuned PI (Skogestad, 2003), or the MPC that knows the process."""
    if loop.controller == "MPC":
        return UnawareMpc(process)
    constant = 1.0 / loop.sampling
    delay = loop.dead_time + 0.5 + (0.25 * constant if loop.process == "second order" else 0.0)
    closed = max(delay, 0.7 * constant)
    factor = loop.aggressive * (2.5 if loop.trouble == "tuning" else 1.0)
    if process.is_integrating:
        gain, reset = 1.0 / (process.b[0] * (closed + delay)), 4.0 * (closed + delay)
    else:
        gain, reset = constant / (closed + delay), min(constant, 4.0 * (closed + delay))
    return PiController(PiSettings(gain=factor * gain, integral_time=reset))


class _Memory:
    """A valve model with memory as a law that `compensator.study` understands."""

    def __init__(self, valve: SlipStickValve) -> None:
        self._valve = valve
        self._state = valve.start(_REST, _REST)

    def __call__(self, _stem: float, op: float) -> float:
        self._state = self._valve.step(self._state, op)
        return self._state.stem


# Pneumatic sliding-stem valve of Choudhury et al. (2005), Table 2, in SI units: stem mass, spring,
# viscous friction, travel. Friction is set so that fS and fD come out as drawn.
_MASS, _SPRING, _VISCOUS, _TRAVEL = 1.36, 52500.0, 612.0, 0.1016
_STILL = 1e-5


@njit(cache=True)
def _karnopp(
    position: float, speed: float, op: float, static: float, dynamic: float, period: float
) -> tuple[float, float]:
    """One period of mass, spring and Karnopp friction; OP acts as a force of the diaphragm."""
    step = 2e-4
    for _ in range(round(period / step)):
        force = _SPRING * (op * _TRAVEL / 100.0 - position)
        if abs(speed) < _STILL:
            if abs(force) <= static:
                speed = 0.0
                continue
            net = force - np.sign(force) * dynamic
        else:
            net = force - np.sign(speed) * dynamic - _VISCOUS * speed
        faster = speed + step * net / _MASS
        # Friction stops a stem, it never turns it round.
        speed = 0.0 if faster * speed < 0.0 else faster
        position += step * speed
    return position, speed


class KarnoppValve:
    """Karnopp's friction on a pneumatic valve: a physics that no model of the estimator has.

    Source: Karnopp (1985), J. Dyn. Syst. Meas. Control 107, 100-103.
    """

    def __init__(self, stick_band: float, slip_jump: float) -> None:
        newton = _SPRING * _TRAVEL / 100.0
        self._static = 0.5 * (stick_band + slip_jump) * newton
        self._dynamic = 0.5 * (stick_band - slip_jump) * newton
        self._position, self._speed = _REST * _TRAVEL / 100.0, 0.0

    def __call__(self, _stem: float, op: float) -> float:
        """Position of the stem, in percent, after one second of ``op``; it knows its own stem."""
        self._position, self._speed = _karnopp(
            self._position, self._speed, op, self._static, self._dynamic, 1.0
        )
        return self._position * 100.0 / _TRAVEL


def _valve(loop: Loop) -> StemLaw | None:
    if loop.is_healthy:
        return None
    pair = (loop.stick_band, loop.slip_jump)
    if loop.physics == "Karnopp":
        return KarnoppValve(*pair)
    kinds: dict[str, type[SlipStickValve]] = {
        "He": HeValve,
        "Kano": KanoValve,
        "Choudhury": ChoudhuryValve,
    }
    return _Memory(kinds[loop.physics](*pair))


def _load(loop: Loop, samples: int, rng: np.random.Generator) -> Array:
    """Load disturbance, in OP."""
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


def _turns(stem: Array) -> int:
    moves = np.diff(stem)
    moves = moves[np.abs(moves) > 1e-6]
    return int(np.count_nonzero(moves[1:] * moves[:-1] < 0.0))


def record(loop: Loop, *, samples: int = 1000) -> Recording:
    """Run the loop and return its last ``samples``.

    It runs twice: the first run, with hardly any noise, gives the swing that scales the noise.
    """
    total = _SETTLE + samples
    window = slice(_SETTLE, total)
    rng = np.random.default_rng([loop.seed, int(loop.is_healthy), 7])
    process = _process(loop)
    # An integrating process answers to OP with a fifth of the others' PV in a time constant.
    size = 2.0 * max(loop.stick_band, 1.0) * (0.2 if process.is_integrating else 1.0)
    changes = [(0, 0.0), (50, size)]
    if rng.random() < 0.3:
        changes.append((_SETTLE + int(rng.integers(100, samples - 100)), 0.0))
    # A trace of noise, so that no loop comes to rest because its stem happens to stop on target.
    quiet = Study(
        setpoint=changes,
        samples=total,
        seed=loop.seed,
        op0=_REST,
        measurement_noise=0.0025 * size,
    )
    clean = run(process, _valve(loop), _controller(loop, process), quiet)
    error = (clean.pv - clean.sp)[window]
    swing = 0.5 if loop.is_healthy else max(float(error.std()), 0.02 * loop.stick_band)
    noisy = replace(
        quiet,
        load=list(enumerate(_load(loop, total, rng).tolist())),
        measurement_noise=loop.noise * swing,
    )
    trace = run(process, _valve(loop), _controller(loop, process), noisy)
    return Recording(
        trace.op[window],
        trace.pv[window],
        trace.sp[window],
        trace.stem[window],
        _turns(clean.stem[window]),
    )
