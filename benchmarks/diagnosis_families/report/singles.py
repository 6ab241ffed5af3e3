"""Single loops of the report family, of one cause or of two."""

from __future__ import annotations

import math
import zlib

import numpy as np

from benchmarks.diagnosis_families.records import Floats, LoopRecord
from benchmarks.diagnosis_families.report.parts import Controller, Plant, Sensor, Valve

__all__ = ["draw_loop", "draw_plant"]

_WARM = 400
_TRIES = 60


def draw_plant(rng: np.random.Generator, *, level: bool | None = None) -> Plant:
    """A plant with dead time; one in six is a level."""
    is_level = bool(rng.random() < 0.17) if level is None else level
    first = float(rng.triangular(3.0, 12.0, 45.0))
    second = float(rng.uniform(0.0, 0.4)) * first
    dead = float(rng.uniform(0.5, 8.0))
    gain = float(rng.uniform(0.5, 2.0) * rng.choice([-1.0, 1.0]))
    if is_level:
        return Plant(gain / float(rng.uniform(20.0, 120.0)), 1.0, float(rng.uniform(0.1, 3.0)),
                     dead, True)  # fmt: skip
    return Plant(gain, first, second, dead, False)


def draw_loop(
    causes: tuple[str, ...],
    seed: int,
    samples: int = 1600,
    settings: tuple[float, float] | None = None,
) -> LoopRecord:
    """The loop of those causes and that seed; the same arguments give the same loop.

    With ``settings`` (gain, integral time in samples) it is the same loop under that controller.
    """
    key = zlib.crc32(("report " + " ".join(causes)).encode())
    for attempt in range(_TRIES):
        rng = np.random.default_rng([seed, key, attempt])
        found = _draw(causes, rng, samples, f"{'+'.join(causes)}-{seed}")
        if found is not None and settings is not None:
            rng = np.random.default_rng([seed, key, attempt])
            found = _draw(causes, rng, samples, found.name, settings)
            assert found is not None
        if found is not None:
            return found
    raise RuntimeError(f"no sensible loop for {causes} {seed} in {_TRIES} draws")


def _slow_noise(rng: np.random.Generator, n: int, size: float, bend: float) -> Floats:
    """Noise of a power that falls beyond a frequency, by shaping a spectrum."""
    f = np.fft.rfftfreq(n)
    shaped = np.fft.rfft(rng.standard_normal(n)) / (1.0 + (f * bend * 6.3) ** 2)
    found = np.fft.irfft(shaped, n)
    return np.asarray(size * (found - found.mean()) / found.std())


def _levels(rng: np.random.Generator, n: int, size: float, gap: float) -> Floats:
    out = np.zeros(n)
    at = int(_WARM + rng.uniform(0.3, 1.0) * gap)
    while at < n:
        out[at:] = size * rng.uniform(-1.0, 1.0)
        at += int(rng.exponential(0.6 * gap) + 0.5 * gap)
    return out


def _draw(
    causes: tuple[str, ...],
    rng: np.random.Generator,
    samples: int,
    name: str,
    settings: tuple[float, float] | None = None,
) -> LoopRecord | None:
    n = samples + _WARM
    plant = draw_plant(rng, level=False if "characteristic" in causes else None)
    kc, ti = plant.simc(float(rng.uniform(1.0, 2.0)))
    late = plant.dead + 0.5 + 0.5 * plant.second
    valve, scale = Valve(), 2.0 * late + 2.0
    load = _slow_noise(rng, n, float(rng.uniform(0.4, 1.2)), float(rng.uniform(15.0, 60.0)))
    size = abs(plant.gain) * (60.0 if plant.level else 1.0)
    noise = min(float(rng.uniform(0.01, 0.15)) * size, 0.25 / abs(kc))
    sp, cycle = np.zeros(n), math.nan
    if "tight_tuning" in causes:
        ti *= float(rng.uniform(0.6, 1.0))
        kc = plant.ultimate(ti) / float(rng.uniform(1.05, 1.3))
        load += _slow_noise(rng, n, 0.8, 3.0)
    if "slow_tuning" in causes:
        kc *= float(rng.uniform(0.07, 0.2))
        load = 2.0 * load + _levels(rng, n, 8.0, 28.0 * scale)
    if "sticky_valve" in causes:
        stick = float(rng.uniform(3.0, 12.0))
        valve = Valve(stick=stick, jump=stick * float(rng.uniform(0.15, 0.95)))
    if "external_oscillation" in causes:
        cycle = scale * float(rng.uniform(4.0, 16.0))
        phase = 2.0 * math.pi * (np.arange(n) / cycle + rng.random())
        phase = phase + np.cumsum(rng.standard_normal(n)) * float(rng.choice([0.0, 0.015]))
        wave = np.sin(phase) if rng.random() < 0.6 else np.clip(2.0 * np.sin(phase), -1.0, 1.0)
        load += float(rng.uniform(2.0, 8.0)) * wave
    high = 100.0
    if "saturation" in causes:
        push = float(rng.uniform(12.0, 25.0))
        load -= push * np.sin(2.0 * math.pi * np.arange(n) / (n * float(rng.uniform(0.25, 0.5))))
        high = 50.0 + push * float(rng.uniform(0.0, 0.7))
    if "characteristic" in causes:
        valve.shape = float(rng.uniform(2.2, 4.0)) ** float(rng.choice([-1.0, 1.0]))
        kc = plant.ultimate(ti) / float(rng.uniform(2.2, 3.2))
        sp += plant.gain * _levels(rng, n, 35.0, 22.0 * scale)
    elif rng.random() < 0.25 and "manual" not in causes:
        sp += size * _levels(rng, n, float(rng.uniform(2.0, 5.0)), 30.0 * scale)
    sensor, kind = Sensor(noise, rng), ""
    if "sensor" in causes:
        kind = str(rng.choice(["noisy", "spikes", "coarse", "frozen"]))
        if kind == "noisy":
            sensor.noise = max(2.0 * size, 1.2 / abs(kc))
        elif kind == "spikes":
            sensor.spikes, sensor.spike_size = float(rng.uniform(0.005, 0.02)), 15.0 * size
        elif kind == "coarse":
            sensor.step = 2.5 * size
        else:
            start = _WARM + int(rng.uniform(0.2, 0.5) * samples)
            sensor.frozen = (start, start + int(rng.uniform(0.15, 0.4) * samples))
    hand = np.full(n, np.nan)
    if "manual" in causes:
        hand[_WARM + int(rng.uniform(0.0, 0.4) * samples) :] = 50.0 + rng.uniform(-3.0, 3.0)
    kc, ti = settings or (kc, ti)
    op, pv = _simulate(plant, valve, Controller(kc, ti, 0.0, 0.0, high), sensor, load, sp, hand)
    keep = slice(_WARM, None)
    op, pv, sp = op[keep], pv[keep], sp[keep]
    if settings is None and not _is_fair(causes, kind, op, pv, sp, valve, noise, high):
        return None
    scan = float(rng.choice([1.0, 4.0, 10.0]))
    return LoopRecord(
        name, causes, op, pv + 30.0, sp + 30.0, np.isnan(hand[keep]), scan,
        (kc, ti * scan, 0.0), noise, cycle * scan,
        f"gain {plant.gain:.3g}, lags {plant.first:.1f} {plant.second:.1f}, dead {plant.dead:.1f}"
        f"{', level' if plant.level else ''} {kind}",
    )  # fmt: skip


def _simulate(
    plant: Plant,
    valve: Valve,
    controller: Controller,
    sensor: Sensor,
    load: Floats,
    sp: Floats,
    hand: Floats,
) -> tuple[Floats, Floats]:
    n = load.size
    op, pv, y = np.empty(n), np.empty(n), 0.0
    for k in range(n):
        pv[k] = sensor.read(y, k)
        if math.isnan(hand[k]):
            op[k] = controller.step(float(sp[k]), float(pv[k]))
        else:
            op[k] = hand[k]
            controller.follow(float(op[k]), float(sp[k]), float(pv[k]))
        y = plant.step(valve.flow(float(op[k])) + float(load[k]))
    return op, pv


def _is_fair(
    causes: tuple[str, ...],
    kind: str,
    op: Floats,
    pv: Floats,
    sp: Floats,
    valve: Valve,
    noise: float,
    high: float,
) -> bool:
    """Whether the record can show its causes at all."""
    if not np.isfinite(pv).all() or np.ptp(pv) > 1e4:
        return False
    limited = float(np.mean((op >= high - 1e-9) | (op <= 1e-9)))
    if "saturation" in causes:
        if not 0.1 < limited < 0.8:
            return False
    elif limited > 0.01 and kind != "frozen":
        return False
    error = float(np.std(sp - pv))
    if "sticky_valve" in causes and np.ptp(op) < valve.stick:
        return False
    if {"external_oscillation", "tight_tuning"} & set(causes) and error < 2.0 * noise:
        return False
    middle = float(np.ptp(np.quantile(op, [0.05, 0.95])))
    return "characteristic" not in causes or middle > 25.0
