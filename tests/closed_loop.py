"""The closed loop of the tests: PI(D) in velocity form, He's valve, a lag or an integrator.

`simulate` steps it. `run` asks for it as a control engineer would (settings, loads at the process's
entry); `settled_loop` as the estimator's tests do (SIMC settings, disturbances on PV, the stem
told).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from loop_model import ValveModel

__all__ = ["Loop", "Valve", "run", "settled_loop", "simulate"]

Floats = NDArray[np.float64]


class Valve(Protocol):
    """A valve that steps from its stem and OP to its next stem."""

    def step(self, stem: float, op: float) -> float: ...


_SETTLING = 600
"""Samples that `settled_loop` leaves out."""
_BENT_ABOUT = 7.0
"""The stem at which a bent characteristic has the straight one's value: the usual set-point."""


@dataclass(frozen=True)
class Loop:
    """OP, PV and SP of a run."""

    op: Floats
    pv: Floats
    sp: Floats


def simulate(
    target: Floats,
    load: Floats,
    added: Floats,
    *,
    settings: tuple[float, float, float],
    process: tuple[float, float],
    dead_time: int,
    valve: Valve | None,
    rest: float = 0.0,
    curve: float = 0.0,
    limits: tuple[float, float] = (-math.inf, math.inf),
) -> tuple[Floats, Floats, Floats]:
    """OP, PV and stem, each ``(n,)``, from rest.

    Args:
        target: set-point.
        load: at the process's entry, units of OP.
        added: to PV behind the process, noise included; the controller sees it. NaN: the
            transmitter repeats its last value.
        settings: gain, integral and derivative time, in samples.
        process: pole and the gain of a sample: ``y = pole y + gain flow``.
        dead_time: samples from the stem to PV, 1 and more.
        valve: None is a healthy one.
        rest: OP at which PV rests at zero.
        curve: the flow is ``x + curve (x - 7)^2``.
        limits: of OP.
    """
    gain, integral_time, derivative_time = settings
    pole, entry = process
    n = target.size
    op, pv, stem = np.empty(n), np.empty(n), np.empty(n)
    u = x = rest
    y = last_e = last = older = 0.0
    moved = [rest] * dead_time
    for k in range(n):
        pv[k] = pv[k - 1] if math.isnan(added[k]) else y + added[k]
        e = target[k] - pv[k]
        u += gain * ((e - last_e) + e / integral_time)
        if derivative_time:
            u -= gain * derivative_time * (pv[k] - 2.0 * last + older)
        u = min(max(u, limits[0]), limits[1])
        last_e, older, last = e, last, pv[k]
        x = u if valve is None else valve.step(x, u)
        op[k], stem[k] = u, x
        moved = [x, *moved[:-1]]
        flow = moved[-1] + curve * (moved[-1] - _BENT_ABOUT) ** 2
        y = pole * y + entry * (flow - rest + load[k])
    return op, pv, stem


def run(
    *,
    gain: float = 0.8,
    integral_time: float = 12.0,
    derivative_time: float = 0.0,
    process_gain: float = 1.5,
    lag: float = 12.0,
    dead: int = 3,
    band: float = 0.0,
    jump: float = 0.0,
    load: Floats | None = None,
    noise: float = 0.02,
    faults: Floats | None = None,
    sp: Floats | None = None,
    limits: tuple[float, float] = (0.0, 100.0),
    n: int = 1500,
    seed: int = 1,
) -> Loop:
    """A loop about 50 % with a load that wanders; ``load`` is added to it, in units of OP.

    ``faults`` are added to PV as `simulate` has it.
    """
    rng = np.random.default_rng(seed)
    warm = 300
    before = np.zeros(warm)
    push = np.concatenate([before, np.zeros(n) if load is None else load])
    target = np.concatenate([before, np.zeros(n) if sp is None else sp])
    drawn = rng.standard_normal((n + warm, 2))
    walk = np.zeros(n + warm)
    level = 0.0
    for k in range(walk.size):
        level = 0.97 * level + 0.15 * drawn[k, 1]
        walk[k] = level
    pole = float(np.exp(-1.0 / lag))
    op, pv, _ = simulate(
        target,
        push + walk,
        noise * drawn[:, 0] + (0.0 if faults is None else np.concatenate([before, faults])),
        settings=(gain, integral_time, derivative_time),
        process=(pole, (1.0 - pole) * process_gain),
        dead_time=dead + 1,
        valve=ValveModel(band, jump) if band > 0.0 else None,
        rest=50.0,
        limits=limits,
    )
    return Loop(op[warm:], 50.0 + pv[warm:], 50.0 + target[warm:])


def settled_loop(
    valve: ValveModel | None,
    *,
    samples: int = 1000,
    time_constant: float = 6.0,
    dead_time: int = 2,
    integrating: bool = False,
    noise: float = 0.05,
    drift: float = 0.0,
    sine: float = 0.0,
    triangle: float = 0.0,
    curve: float = 0.0,
    seed: int = 0,
    aggressive: float = 1.0,
    setpoints: Sequence[float] = (7.0,),
) -> tuple[Floats, Floats, Floats]:
    """OP, PV and stem of a settled loop (gain 1, SIMC tuning, OP about 47).

    Outside oscillations have a period of 60 samples; ``drift`` is the step of a slow walk on PV.
    """
    rng = np.random.default_rng(seed)
    total = samples + _SETTLING
    pole = float(np.exp(-1.0 / time_constant))
    closed = max(float(dead_time), 0.5 * time_constant)
    slope = 0.05 if integrating else 1.0 / time_constant
    integral = 4.0 * (closed + dead_time)
    if not integrating:
        integral = min(time_constant, integral)
    drawn = rng.standard_normal((total, 2))
    target, added = np.empty(total), np.empty(total)
    walk = 0.0
    for k in range(total):
        target[k] = setpoints[k * len(setpoints) // total]
        walk = 0.999 * walk + drift * drawn[k, 0]
        outside = sine * np.sin(2.0 * np.pi * k / 60.0)
        outside += triangle * (2.0 * abs(2.0 * (k / 60.0 % 1.0) - 1.0) - 1.0)
        added[k] = walk + outside + noise * drawn[k, 1]
    op, pv, stem = simulate(
        target,
        np.zeros(total),
        added,
        settings=(aggressive / (slope * (closed + dead_time)), integral, 0.0),
        process=(1.0, 0.05) if integrating else (pole, 1.0 - pole),
        dead_time=dead_time,
        valve=valve,
        curve=curve,
    )
    return op[_SETTLING:] + 40.0, pv[_SETTLING:], stem[_SETTLING:] + 40.0
