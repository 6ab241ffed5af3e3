"""Quiet, slow and sticky loops under loads of every pace, with dead times from short to long.

Well tuned is what SIMC gives with a closed-loop time constant of one to three dead times (Skogestad
2003, as improved by Grimholt and Skogestad 2012 for long dead times). Slow is a fifth to a
fifteenth of the integral gain that one dead time gives, by a small gain, a long integral time, or
both. What lies between is neither and is not drawn. A slow loop counts as such where SIMC's
settings would halve the squared error of its own record. A valve that sticks (slips, or slides) is
in a loop that is tuned well.
"""

from __future__ import annotations

import math
import zlib

import numpy as np

from benchmarks.diagnosis_families.records import Floats, LoopRecord
from benchmarks.diagnosis_families.tuning.advised import WARM, Plant, simulate, time_scale
from benchmarks.diagnosis_families.tuning.singles import log_uniform, red

__all__ = ["KINDS", "draw_paced"]

KINDS = ("quiet", "slow_tuning", "sticky_valve", "sliding_valve")
_ATTEMPTS = 80
_REMOVED = 0.5
"""Share of the squared error that good settings take from a loop that is slow on its record."""


def _draw_plant(rng: np.random.Generator) -> Plant:
    """A lag or two or an integrator, the dead time a twelfth of the lag to three times as long."""
    dead = log_uniform(rng, 1.0, 12.0)
    lag = float(np.clip(dead * log_uniform(rng, 0.33, 12.0), 2.0, 60.0))
    second = lag * rng.uniform(0.05, 0.5) if rng.uniform() < 0.5 else 0.0
    integrating = bool(rng.uniform() < 0.2)
    gain = log_uniform(rng, 0.4, 2.5) * float(rng.choice([-1.0, 1.0]))
    actuator = float(rng.uniform(0.3, 1.5)) if rng.uniform() < 0.3 else 0.0
    lags = (second,) if integrating else (lag, second)
    return Plant(
        gain / lag if integrating else gain,
        tuple(one for one in lags if one > 0.0), dead, integrating, 0.0, actuator,
    )  # fmt: skip


def _simc(plant: Plant, speed: float) -> tuple[float, float]:
    """SIMC's PI (gain, integral time), closed-loop time constant ``speed`` dead times."""
    lags = [*sorted(plant.lags, reverse=True), 0.0, 0.0]
    behind = lags[0] if plant.integrating else lags[1]
    dead = plant.dead + 1.0 + plant.actuator + 0.5 * behind
    wait = (speed + 1.0) * dead
    if plant.integrating:
        return 1.0 / (plant.gain * wait), 4.0 * wait
    lag = lags[0] + 0.5 * behind
    # a third of the dead time more: SIMC as improved for long dead times
    lag += dead / 3.0
    return lag / (plant.gain * wait), min(lag, 4.0 * wait)


def _slow(plant: Plant, rng: np.random.Generator) -> tuple[float, float]:
    """Settings of a fifth to a fifteenth of SIMC's integral gain."""
    kc, ti = _simc(plant, 1.0)
    share = log_uniform(rng, 1.0 / 15.0, 0.2)
    how = float(rng.choice([0.0, 0.5, 1.0]))
    if plant.integrating:
        # a small gain alone swings over an integrator: the integral time grows with it
        how = 0.5
    return kc * share ** (1.0 - how), ti / share**how


def _loads(plant: Plant, rng: np.random.Generator, n: int) -> tuple[Floats, Floats]:
    """Load before the process (units of OP) and behind it (units of PV)."""
    scale = time_scale(plant)
    steady = abs(plant.gain) * (scale if plant.integrating else 1.0)
    load, behind = np.zeros(n), np.zeros(n)
    for _ in range(int(rng.integers(1, 4))):
        size, kind = log_uniform(rng, 0.4, 3.0), rng.integers(4)
        if kind == 0:
            one = red(rng, n, size, scale * log_uniform(rng, 1.0, 30.0))
        elif kind == 1:
            # smooth: its rate is red too
            time = scale * log_uniform(rng, 2.0, 20.0)
            one = _smooth(red(rng, n, 1.0, time), time)
            one *= size / np.std(one)
        elif kind == 2:
            one = np.cumsum(rng.standard_normal(n)) * size / math.sqrt(20.0 * scale)
        else:
            swing = 2.0 * math.pi * np.arange(n) / n * rng.uniform(0.7, 2.5)
            one = 3.0 * size * np.sin(swing + rng.uniform(0.0, 6.0))
        if rng.uniform() < 0.7:
            load += one
        else:
            behind += steady * one
    if rng.uniform() < 0.3:
        at = 0.0
        while at < n:
            load[int(at) :] += rng.uniform(-4.0, 4.0)
            at += 30.0 * scale * rng.uniform(0.4, 1.6)
    return load - load.mean(), behind - behind.mean()


def _smooth(x: Floats, time: float) -> Floats:
    pole, level = math.exp(-1.0 / time), 0.0
    out = np.empty(x.size)
    for k in range(x.size):
        level = pole * level + (1.0 - pole) * x[k]
        out[k] = level
    return out


def draw_paced(
    kind: str,
    seed: int,
    samples: int = 1800,
    settings: tuple[float, float] | None = None,
) -> LoopRecord:
    """Return a loop by kind and seed, with ``settings`` under that PI (times in scans)."""
    key = zlib.crc32(f"paced/{kind}".encode())
    n = samples + WARM
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([key, seed, attempt])
        plant = _draw_plant(rng)
        good = _simc(plant, 1.0)
        kc, ti = _slow(plant, rng) if kind == "slow_tuning" else _simc(plant, rng.uniform(1.0, 3.0))
        load, behind = _loads(plant, rng, n)
        steady = abs(plant.gain) * (time_scale(plant) if plant.integrating else 1.0)
        noise = min(steady * log_uniform(rng, 0.01, 0.2), 0.3 / abs(kc)) * rng.standard_normal(n)
        sp = np.zeros(n)
        if rng.uniform() < 0.4:
            for one in rng.integers(0, n, max(2, int(n / 40.0 / time_scale(plant)))):
                sp[one:] = steady * rng.uniform(-3.0, 3.0)
        scan = float(rng.choice([1.0, 2.0, 5.0]))
        put_in = load, behind, noise, sp
        sticks, slides = kind in ("sticky_valve", "sliding_valve"), kind == "sliding_valve"
        stick = log_uniform(rng, 3.0, 12.0) if sticks else 0.0
        valve = (stick, stick * rng.uniform(0.2, 1.0)) if sticks else (0.0, 0.0)
        op, pv = simulate(plant, (kc, ti), valve, put_in, slides=slides)
        better = simulate(plant, good, (0.0, 0.0), put_in)[1]
        if not np.isfinite(pv).all() or np.mean((op <= 0.0) | (op >= 100.0)) > 0.0:
            continue
        left = float(np.mean((sp[WARM:] - better) ** 2) / np.mean((sp[WARM:] - pv) ** 2))
        if kind == "slow_tuning" and left > 1.0 - _REMOVED:
            continue
        if sticks and np.ptp(op) < stick:
            continue
        if settings is not None:
            kc, ti = settings
            op, pv = simulate(plant, settings, valve, put_in, slides=slides)
        return LoopRecord(
            f"{kind}-{seed}", ("sticky_valve" if sticks else kind,), op, pv, sp[WARM:],
            np.ones(samples, dtype=bool), scan,
            (kc, ti * scan, 0.0), float(np.std(noise)), math.nan,
            f"gain {plant.gain:.3g}, lags {[round(v, 1) for v in plant.lags]}, dead "
            f"{plant.dead:.1f}{', integrating' if plant.integrating else ''}, integral gain "
            f"{kc / ti / (good[0] / good[1]):.2f} of SIMC's, which leaves {left:.2f}, "
            f"S {valve[0]:.1f} J {valve[1]:.1f}",
        )  # fmt: skip
    raise RuntimeError(f"no sensible loop for {kind} {seed} in {_ATTEMPTS} draws")
