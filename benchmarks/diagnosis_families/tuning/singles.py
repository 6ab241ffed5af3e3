"""Single loops of one cause or two: a process, SIMC's tuning made faster or slower, a fault."""

from __future__ import annotations

import math
import zlib
from dataclasses import replace

import numpy as np

from benchmarks.diagnosis_families.records import Floats, LoopRecord
from benchmarks.diagnosis_families.tuning.network import Loop, Signals, simulate

__all__ = ["draw_healthy", "draw_loop", "log_uniform", "red", "spoil_tuning"]

_WARM = 600
_ATTEMPTS = 60


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def red(rng: np.random.Generator, n: int, size: float, time: float) -> Floats:
    """First-order noise of that standard deviation and correlation time."""
    pole = math.exp(-1.0 / time)
    white = rng.standard_normal(n) * size * math.sqrt(1.0 - pole * pole)
    out = np.empty(n)
    level = 0.0
    for k in range(n):
        level = pole * level + white[k]
        out[k] = level
    return out


def _open_loop(loop: Loop, w: Floats) -> np.ndarray:
    """Exact response of the sampled loop, controller included."""
    q = np.exp(-1j * w)
    p1 = 1.0 if loop.integrating else math.exp(-1.0 / loop.lag)
    entry = 1.0 / loop.lag if loop.integrating else 1.0 - p1
    p2 = math.exp(-1.0 / loop.second) if loop.second > 0.05 else 0.0
    process = loop.gain * entry * (1.0 - p2) / ((1.0 - p1 * q) * (1.0 - p2 * q))
    control = loop.kc * (1.0 + 1.0 / (loop.ti * (1.0 - q)) + loop.td * (1.0 - q))
    return np.asarray(process * control * q ** (loop.delay + 1))


def gain_margin(loop: Loop) -> float:
    """The least factor on the gain that makes the loop swing."""
    w = np.geomspace(1e-4, 3.1, 4000)
    found = _open_loop(loop, w)
    cross = (np.sign(found.imag[1:]) != np.sign(found.imag[:-1])) & (found.real[1:] < 0.0)
    return 1.0 / float(np.max(-found.real[1:][cross])) if cross.any() else math.inf


def draw_healthy(rng: np.random.Generator, n: int, *, integrating: float = 0.2) -> Loop:
    """A well-tuned loop with a healthy valve, little noise and a mild load."""
    is_level = bool(rng.uniform() < integrating)
    lag = log_uniform(rng, 20.0, 150.0) if is_level else log_uniform(rng, 4.0, 40.0)
    second = lag * rng.uniform(0.05, 0.5) if not is_level else rng.uniform(0.0, 4.0)
    delay = int(rng.integers(1, max(3, int(0.6 * min(lag, 20.0)))))
    gain = log_uniform(rng, 0.4, 2.5) * float(rng.choice([-1.0, 1.0]))
    wait = delay + 1.0 + 0.5 * second
    speed = rng.uniform(1.0, 1.8)
    main = lag if is_level else lag + 0.5 * second
    closed = speed * wait
    kc = main / (closed + wait) / gain
    ti = 4.0 * (closed + wait) if is_level else min(main, 4.0 * (closed + wait))
    td = 0.3 * wait if rng.uniform() < 0.2 else 0.0
    zeros = np.zeros(n)
    # an engineer filters noise that moves the valve by more than this
    quiet = min(abs(gain) * log_uniform(rng, 0.02, 0.3), 0.3 / abs(kc))
    return Loop(
        gain, lag, second, delay, is_level, kc, ti, td, 0.0, 0.0, 0.0, 0.0, 100.0,
        load=red(rng, n, rng.uniform(0.5, 1.5), rng.uniform(20.0, 120.0)),
        wave=zeros,
        noise=rng.standard_normal(n) * quiet,
        sp=zeros.copy(),
        hand=np.full(n, np.nan),
    )  # fmt: skip


def spoil_tuning(
    loop: Loop,
    rng: np.random.Generator,
    how: str,
    margins: tuple[float, float] = (1.04, 1.35),
) -> Loop:
    """The loop tuned too tight (to a gain margin between those given) or too slow."""
    if how == "tight_tuning":
        ti = loop.ti * rng.uniform(0.5, 1.0)
        tighter = replace(loop, ti=ti, td=0.0)
        margin = rng.uniform(*margins)
        return replace(tighter, kc=tighter.kc * gain_margin(tighter) / margin)
    share = log_uniform(rng, 0.06, 0.2)
    if loop.integrating:
        return replace(loop, kc=loop.kc * share, ti=loop.ti / share)
    return replace(loop, kc=loop.kc * share)


def _wave(rng: np.random.Generator, n: int, period: float) -> Floats:
    wander = np.cumsum(rng.standard_normal(n)) * rng.choice([0.0, 0.01, 0.03])
    phase = 2.0 * math.pi * (np.arange(n) / period + rng.uniform()) + wander
    shape = rng.integers(3)
    if shape == 0:
        return np.sin(phase)
    if shape == 1:
        return np.asarray(2.0 / math.pi * np.arcsin(np.sin(phase)))
    return np.sin(phase) + 0.25 * np.sin(2.0 * phase + rng.uniform(0.0, 6.0))


def _steps(rng: np.random.Generator, n: int, size: float, gap: float) -> Floats:
    out = np.zeros(n)
    at = int(rng.uniform(0.2, 1.0) * gap)
    level = 0.0
    while at < n:
        level = float(rng.uniform(0.4, 1.0) * size * rng.choice([-1.0, 1.0]))
        out[at:] = level
        at += int(gap * rng.uniform(0.6, 1.6))
    return out


def _time_scale(loop: Loop) -> float:
    return 2.0 * (loop.delay + 1.0 + 0.5 * loop.second) + 2.0


def _apply(cause: str, loop: Loop, rng: np.random.Generator, n: int) -> tuple[Loop, float]:
    """The loop with a cause put in, and the period of an outside wave (scans, NaN without)."""
    scale = _time_scale(loop)
    period = math.nan
    if cause == "sticky_valve":
        stick = log_uniform(rng, 3.0, 15.0)
        loop = replace(loop, stick=stick, jump=stick * rng.uniform(0.2, 1.0))
    elif cause == "external_oscillation":
        period = scale * log_uniform(rng, 5.0, 25.0)
        size = log_uniform(rng, 2.0, 8.0)
        loop = replace(loop, load=loop.load + size * _wave(rng, n, period))
    elif cause in ("tight_tuning", "slow_tuning"):
        loop = spoil_tuning(loop, rng, cause)
        if cause == "slow_tuning":
            loop = replace(loop, load=loop.load * 2.0 + _steps(rng, n, 6.0, 30.0 * scale))
        loop = replace(loop, load=loop.load + red(rng, n, 1.0, 5.0))
    elif cause == "characteristic":
        curve = rng.uniform(3.0, 5.0) * float(rng.choice([-1.0, 1.0]))
        # tuned where the gain is middling: tight at the one end, slow at the other
        factor = gain_margin(loop) / rng.uniform(2.0, 3.0)
        loop = replace(loop, curve=curve, kc=loop.kc * factor)
        swing = _steps(rng, n, 30.0, 22.0 * scale)
        if rng.uniform() < 0.5:
            loop = replace(loop, load=loop.load - _flow_of(swing, curve))
        else:
            loop = replace(loop, sp=loop.gain * _flow_of(swing, curve))
    elif cause == "saturation":
        share = rng.uniform(0.3, 0.8)
        size = rng.uniform(10.0, 25.0)
        push = size * np.sin(2 * math.pi * np.arange(n) / (n * rng.uniform(0.2, 0.6)))
        limit = float(np.quantile(-push, 1.0 - share)) if share < 0.95 else 0.0
        loop = replace(loop, load=loop.load + push, high=50.0 + limit)
    return loop, period


def _flow_of(stem: Floats, curve: float) -> Floats:
    return np.asarray(100.0 / curve * (np.exp(curve * stem / 100.0) - 1.0))


def _spoil_signals(
    causes: tuple[str, ...], signals: Signals, rng: np.random.Generator, loop: Loop
) -> tuple[Loop, str]:
    del signals
    n = loop.load.size
    note = ""
    if "manual" in causes:
        start = int(rng.uniform(0.0, 0.35) * (n - _WARM)) + _WARM
        hand = np.full(n, np.nan)
        hand[start:] = 50.0
        steps = rng.integers(0, 4)
        for at in rng.integers(start, n, steps):
            hand[at:] += rng.uniform(-6.0, 6.0)
        loop = replace(loop, hand=hand)
    if "sensor" in causes:
        kind = str(rng.choice(["noisy", "spikes", "quantised", "frozen"]))
        note = kind
        if kind == "noisy":
            size = abs(loop.gain) * rng.uniform(2.0, 5.0)
            loop = replace(loop, noise=loop.noise + size * rng.standard_normal(n))
        if kind == "spikes":
            at = rng.uniform(size=n) < rng.uniform(0.005, 0.02)
            size = abs(loop.gain) * rng.uniform(10.0, 30.0)
            loop = replace(loop, noise=loop.noise + at * size * rng.choice([-1.0, 1.0], n))
    return loop, note


def draw_loop(
    causes: tuple[str, ...],
    seed: int,
    samples: int = 1800,
    settings: tuple[float, float] | None = None,
) -> LoopRecord:
    """The loop of those causes and that seed; the same arguments give the same loop.

    With ``settings`` (gain, integral time in samples) it is the same loop under that PI controller.
    """
    key = zlib.crc32("+".join(causes).encode())
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([key, seed, attempt])
        found = _draw(causes, rng, samples, f"{'+'.join(causes)}-{seed}")
        if found is not None and settings is not None:
            rng = np.random.default_rng([key, seed, attempt])
            found = _draw(causes, rng, samples, found.name, settings)
            assert found is not None
        if found is not None:
            return found
    raise RuntimeError(f"no sensible loop for {causes} {seed} in {_ATTEMPTS} draws")


def _draw(
    causes: tuple[str, ...],
    rng: np.random.Generator,
    samples: int,
    name: str,
    settings: tuple[float, float] | None = None,
) -> LoopRecord | None:
    n = samples + _WARM
    loop = draw_healthy(rng, n, integrating=0.0 if "characteristic" in causes else 0.2)
    period = math.nan
    for cause in sorted(causes, key=lambda one: "tuning" not in one):
        loop, found = _apply(cause, loop, rng, n)
        period = found if math.isfinite(found) else period
    loop, note = _spoil_signals(causes, Signals(loop.load, loop.load, loop.sp), rng, loop)
    if rng.uniform() < 0.3 and "manual" not in causes and "characteristic" not in causes:
        size = abs(loop.gain) * rng.uniform(2.0, 6.0)
        loop = replace(loop, sp=_steps(rng, n, size, 30.0 * _time_scale(loop)))
    if settings is not None:
        loop = replace(loop, kc=settings[0], ti=settings[1], td=0.0)
    signals = simulate([loop])
    op, pv, sp = (s[0, _WARM:].copy() for s in (signals.op, signals.pv, signals.sp))
    hand = loop.hand[_WARM:]
    if settings is None and not _is_fair(causes, loop, op, pv, sp):
        return None
    error = float(np.std(sp - pv))
    calm = float(np.std(loop.noise))
    if note == "quantised":
        step = max(2.0 * error, 0.5 * abs(loop.gain)) * rng.uniform(0.8, 2.0)
        # the converter is part of the loop: simulate with what it gives
        pv = np.round(pv / step) * step
    if note == "frozen":
        start = int(rng.uniform(0.2, 0.6) * samples)
        pv[start : start + int(rng.uniform(0.2, 0.4) * samples)] = pv[start]
    scan = float(rng.choice([1.0, 2.0, 5.0]))
    return LoopRecord(
        name, causes, op, pv, sp, np.isnan(hand), scan,
        (loop.kc, loop.ti * scan, loop.td * scan), calm, period * scan,
        f"gain {loop.gain:.2f}, lag {loop.lag:.1f}+{loop.second:.1f}, delay {loop.delay + 1}, "
        f"{'integrating, ' if loop.integrating else ''}margin {gain_margin(loop):.2f}, "
        f"S {loop.stick:.1f} J {loop.jump:.1f} {note}",
    )  # fmt: skip


def _is_fair(causes: tuple[str, ...], loop: Loop, op: Floats, pv: Floats, sp: Floats) -> bool:
    """Whether the record can show its causes at all."""
    if not np.isfinite(pv).all() or np.ptp(pv) > 60.0 * max(abs(loop.gain), 1.0):
        return False
    limit = float(np.mean((op >= loop.high - 1e-9) | (op <= loop.low + 1e-9)))
    if "saturation" in causes:
        if not 0.1 < limit < 0.85:
            return False
    elif limit > 0.01:
        return False
    if "characteristic" in causes and np.ptp(np.quantile(op, [0.05, 0.95])) < 20.0:
        # a record of one operating point does not show it
        return False
    error = float(np.std(sp - pv))
    calm = float(np.std(loop.noise))
    if "sticky_valve" in causes and np.ptp(op) < 0.8 * loop.stick:
        return False
    if "external_oscillation" in causes and error < 2.0 * calm:
        return False
    return "tight_tuning" not in causes or error >= 1.5 * calm
