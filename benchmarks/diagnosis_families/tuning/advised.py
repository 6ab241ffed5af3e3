"""Loops for proposed settings: more kinds of processes, loads and noise than `singles` draws.

Between two scans the process moves in ten steps: lags in any number, a dead time of any length, an
actuator with a lag of its own, an inverse response. Loads enter before or behind the process. A
sticky valve slips (He et al. 2007) or slides on while OP goes on (Kano et al. 2004).
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass

import numpy as np
from numba import njit

from benchmarks.diagnosis_families.records import Floats, LoopRecord
from benchmarks.diagnosis_families.tuning.singles import log_uniform, red

__all__ = ["KINDS", "WARM", "Plant", "draw_advised", "simulate", "time_scale"]

KINDS = (
    "well", "tight_tuning", "slow_tuning", "external_oscillation", "sticky_valve", "sliding_valve",
)  # fmt: skip
WARM = 600
"""Scans before the record begins."""
_STEPS = 10
"""Steps of the process in a scan."""
_ATTEMPTS = 40


@dataclass(frozen=True)
class Plant:
    """Times in scans; ``inverse`` is the share of the gain that answers first, in the wrong sense.

    An integrating plant has an integrator behind its lags; ``actuator`` is the lag of the stem.
    """

    gain: float
    lags: tuple[float, ...]
    dead: float
    integrating: bool
    inverse: float
    actuator: float


@njit(cache=True)
def _run(  # type: ignore[no-untyped-def]
    gain, lags, dead, integrating, inverse, actuator, kc, ti, stick, jump, slides,
    load, behind, noise, sp,
):  # fmt: skip
    n = sp.size
    out = np.empty((3, n))
    states = np.zeros(lags.size)
    quick, moved, level = 0.0, 0.0, 0.0
    buffer = np.zeros(dead + 1)
    op, stem = 50.0, 50.0
    static, slide = 0.5 * (stick + jump), 0.5 * (stick - jump)
    last, at, way, older = 0.0, 0, 0.0, 50.0
    for k in range(n):
        clean = level if integrating else (states[-1] if lags.size else 0.0)
        pv = (1.0 + inverse) * clean - inverse * quick + behind[k] + noise[k]
        e = sp[k] - pv
        if k:
            op = min(max(op + kc * (e - last + e / ti), 0.0), 100.0)
        last = e
        gap, goes_on = op - stem, way * (op - older) > 0.0
        older = op
        if gap > static or (goes_on and way > 0.0):
            stem, way = op - slide, slides
        elif gap < -static or (goes_on and way < 0.0):
            stem, way = op + slide, -slides
        else:
            way = 0.0
        out[0, k], out[1, k], out[2, k] = op, pv, stem
        for _ in range(_STEPS):
            if actuator > 0.0:
                moved += (stem - 50.0 - moved) * (1.0 - math.exp(-1.0 / _STEPS / actuator))
            else:
                moved = stem - 50.0
            buffer[at] = gain * (moved + load[k])
            at = (at + 1) % buffer.size
            x = buffer[at]
            for i in range(lags.size):
                states[i] += (x - states[i]) * (1.0 - math.exp(-1.0 / _STEPS / lags[i]))
                x = states[i]
                if i == 0:
                    quick = x
            if integrating:
                level += x / _STEPS
                quick = 0.0
    return out


def _response(plant: Plant, w: Floats) -> np.ndarray:
    """Of the process with sample and hold, ``w`` in radians a scan."""
    s = 1j * w
    found = plant.gain * np.exp(-s * (plant.dead + 0.5)) / (1.0 + plant.actuator * s)
    for lag in plant.lags:
        found = found / (1.0 + lag * s)
    if plant.integrating:
        return np.asarray(found / s)
    rest = np.prod([1.0 + lag * s for lag in plant.lags[1:]], axis=0)
    return np.asarray(found * (1.0 + plant.inverse - plant.inverse * rest))


def _pi(plant: Plant, sensitivity: float) -> tuple[float, float]:
    """A PI controller of that Ms; its integral time goes with the process's ultimate period."""
    w = np.geomspace(1e-4, 3.0, 1500)
    found = _response(plant, w)
    turn = np.unwrap(np.angle(found * np.sign(plant.gain)))
    period = 2.0 * math.pi / float(w[int(np.argmax(turn < -math.pi))])
    ti = period * (1.5 if plant.integrating else 0.4)
    shape = found * np.sign(plant.gain) * (1.0 + 1.0 / (ti * 1j * w))
    low, high = 1e-4 / abs(plant.gain), 1e4 / abs(plant.gain)
    for _ in range(50):
        middle = math.sqrt(low * high)
        open_loop = middle * shape
        size = np.abs(open_loop)
        behind = (size[:-1] >= 1.0) & (size[1:] < 1.0)
        angle = np.unwrap(np.angle(open_loop))[:-1][behind]
        if np.max(1.0 / np.abs(1.0 + open_loop)) > sensitivity or np.any(angle < -math.pi):
            high = middle
        else:
            low = middle
    return low * math.copysign(1.0, plant.gain), ti


def _draw_plant(rng: np.random.Generator) -> Plant:
    integrating = bool(rng.uniform() < 0.2)
    slow = log_uniform(rng, 3.0, 30.0)
    count = int(rng.integers(0 if integrating else 1, 5))
    even = rng.uniform() < 0.3
    lags = tuple(
        sorted(
            (slow if even else slow * rng.uniform(0.05, 1.0) if i else slow for i in range(count)),
            reverse=True,
        )
    )
    lags = tuple(lag / max(1.0, 0.5 * count) for lag in lags)
    dead = float(rng.uniform(0.2, 1.2) * log_uniform(rng, 1.0, max(2.0, slow)))
    gain = log_uniform(rng, 0.3, 3.0) * float(rng.choice([-1.0, 1.0]))
    inverse = float(rng.uniform(0.1, 0.5)) if count > 1 and rng.uniform() < 0.15 else 0.0
    actuator = float(rng.uniform(0.3, 2.0)) if rng.uniform() < 0.5 else 0.0
    if integrating:
        gain, inverse = gain / slow, 0.0
    return Plant(gain, lags, dead, integrating, inverse, actuator)


def time_scale(plant: Plant) -> float:
    return plant.dead + sum(plant.lags) + plant.actuator + 1.0


def _disturb(
    plant: Plant, rng: np.random.Generator, n: int, kind: str
) -> tuple[Floats, Floats, Floats, Floats]:
    """Load before the process (OP), behind it (PV), noise of the transmitter and set-point."""
    steady = abs(plant.gain) * (time_scale(plant) if plant.integrating else 1.0)
    load, behind, sp = np.zeros(n), np.zeros(n), np.zeros(n)
    for _ in range(int(rng.integers(1, 3))):
        size, time = log_uniform(rng, 0.1, 1.5), time_scale(plant) * log_uniform(rng, 1.0, 10.0)
        if rng.uniform() < 0.6:
            load += red(rng, n, size, time)
        else:
            behind += steady * red(rng, n, size, time)
    if rng.uniform() < 0.3:
        drift = np.cumsum(rng.standard_normal(n))
        behind += steady * log_uniform(rng, 0.1, 1.0) * drift / math.sqrt(30.0 * time_scale(plant))
    if kind == "slow_tuning" or rng.uniform() < 0.2:
        at = 0.0
        while at < n:
            load[int(at) :] = load[int(at) :] + rng.uniform(-6.0, 6.0)
            at += 30.0 * time_scale(plant) * rng.uniform(0.4, 1.6)
        load -= load.mean()
    if kind == "external_oscillation":
        period = time_scale(plant) * log_uniform(rng, 3.0, 20.0)
        wander = np.cumsum(rng.standard_normal(n)) * rng.choice([0.0, 0.02])
        load += log_uniform(rng, 2.0, 6.0) * np.sin(2.0 * math.pi * np.arange(n) / period + wander)
    noise = steady * log_uniform(rng, 0.005, 0.1) * rng.standard_normal(n)
    if rng.uniform() < 0.6:
        steps = rng.integers(0, n, max(2, int(n / 40.0 / time_scale(plant))))
        for one in steps:
            sp[one:] = steady * rng.uniform(-4.0, 4.0)
    return load, behind, noise, sp


def simulate(
    plant: Plant,
    settings: tuple[float, float],
    valve: tuple[float, float],
    put_in: tuple[Floats, Floats, Floats, Floats],
    *,
    slides: bool = False,
) -> tuple[Floats, Floats]:
    """OP and PV behind the warm-up; ``valve`` is S and J."""
    op, pv, _ = _run(
        plant.gain, np.array(plant.lags), round(_STEPS * plant.dead), plant.integrating,
        plant.inverse, plant.actuator, *settings, *valve, float(slides), *put_in,
    )[:, WARM:]  # fmt: skip
    return op, pv


def draw_advised(
    kind: str,
    seed: int,
    samples: int = 1800,
    settings: tuple[float, float] | None = None,
) -> LoopRecord:
    """Return a loop by kind and seed, with ``settings`` under that PI (times in scans)."""
    key = zlib.crc32(f"advised/{kind}".encode())
    n = samples + WARM
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([key, seed, attempt])
        plant = _draw_plant(rng)
        kc, ti = _pi(plant, rng.uniform(1.4, 1.9))
        if kind == "tight_tuning":
            kc, ti = _pi(plant, rng.uniform(3.0, 8.0))
        elif kind == "slow_tuning":
            share = log_uniform(rng, 0.08, 0.3)
            kc, ti = kc * share, ti / (share if plant.integrating else 1.0)
        sticks, slides = kind in ("sticky_valve", "sliding_valve"), kind == "sliding_valve"
        stick = log_uniform(rng, 3.0, 12.0) if sticks else 0.0
        jump = stick * rng.uniform(0.2, 1.0)
        put_in = _disturb(plant, rng, n, kind)
        scan = float(rng.choice([1.0, 2.0, 5.0]))
        op, pv = simulate(plant, (kc, ti), (stick, jump), put_in, slides=slides)
        if not np.isfinite(pv).all() or np.mean((op <= 0.0) | (op >= 100.0)) > 0.0:
            continue
        if settings is not None:
            kc, ti = settings
            op, pv = simulate(plant, settings, (stick, jump), put_in, slides=slides)
        _, _, noise, sp = put_in
        causes = ("sticky_valve",) if sticks else () if kind == "well" else (kind,)
        return LoopRecord(
            f"{kind}-{seed}", causes, op, pv, sp[WARM:], np.ones(samples, dtype=bool), scan,
            (kc, ti * scan, 0.0), float(np.std(noise)), math.nan,
            f"gain {plant.gain:.3g}, lags {[round(v, 1) for v in plant.lags]}, dead "
            f"{plant.dead:.1f}, actuator {plant.actuator:.1f}, inverse {plant.inverse:.2f}"
            f"{', integrating' if plant.integrating else ''}, S {stick:.1f} J {jump:.1f}",
        )  # fmt: skip
    raise RuntimeError(f"no sensible loop for {kind} {seed} in {_ATTEMPTS} draws")
