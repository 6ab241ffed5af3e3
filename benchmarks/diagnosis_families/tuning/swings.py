"""Signals with and without an oscillation, by which it was chosen what counts as one.

Waves of four shapes, with a period that wanders, on drifts, red noise and slides; and drifts,
noise, slides and filtered load steps alone, noise behind a well-damped resonance among them.
"""

from __future__ import annotations

import math
import zlib

import numpy as np
from scipy import signal

from benchmarks.diagnosis_families.records import Floats
from benchmarks.diagnosis_families.tuning.singles import log_uniform, red

__all__ = ["RESTING", "SWINGING", "draw_signal"]

SWINGING = ("wave on a drift", "wave in red noise", "wave on slides")
RESTING = ("random walk", "red noise", "smooth drift", "damped resonance", "load steps", "slides")


def draw_signal(kind: str, seed: int) -> tuple[Floats, float]:
    """Return a signal ``(n,)`` and its period in samples, NaN where it has none."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    n = int(rng.choice([600, 1000, 1500, 2500]))
    white = rng.standard_normal(n)
    if kind in SWINGING:
        period = log_uniform(rng, 8.0, n / 6.0)
        background = _background(rng, kind, n, period)
        return _wave(rng, n, period) + background + rng.uniform(0.0, 0.7) * white, period
    return _resting(rng, kind, n) + rng.uniform(0.0, 0.5) * white, math.nan


def _wave(rng: np.random.Generator, n: int, period: float) -> Floats:
    wander = rng.uniform(0.02, 0.25) * red(rng, n, 1.0, period)
    phase = np.cumsum(np.exp(wander) / period) + rng.uniform()
    shape = rng.integers(4)
    if shape == 0:
        values = np.sin(2.0 * np.pi * phase)
    elif shape == 1:
        values = np.sign(np.sin(2.0 * np.pi * phase))
    else:
        values = signal.sawtooth(2.0 * np.pi * phase, 0.5 if shape == 2 else 0.9)
    return np.asarray(values / values.std())


def _background(rng: np.random.Generator, kind: str, n: int, period: float) -> Floats:
    if kind == "wave on a drift":
        drift = np.cumsum(rng.standard_normal(n))
        return np.asarray(rng.uniform(0.3, 3.0) * drift / drift.std())
    if kind == "wave in red noise":
        return red(rng, n, rng.uniform(0.2, 0.8), period * math.exp(rng.uniform(-1.5, 1.5)))
    return rng.uniform(1.0, 5.0) * _slides(rng, n, 5)


def _resting(rng: np.random.Generator, kind: str, n: int) -> Floats:
    if kind == "random walk":
        walk = np.cumsum(rng.standard_normal(n))
        return np.asarray(walk / walk.std())
    if kind == "red noise":
        return red(rng, n, 1.0, log_uniform(rng, 1.0, 50.0))
    if kind == "smooth drift":
        drift = np.cumsum(red(rng, n, 1.0, log_uniform(rng, 3.0, 50.0)))
        return np.asarray(drift / drift.std())
    if kind == "damped resonance":
        damping, turn = rng.uniform(0.3, 0.7), 2.0 * np.pi / log_uniform(rng, 8.0, n / 10.0)
        size = math.exp(-damping * turn)
        cosine = math.cos(turn * math.sqrt(1.0 - damping**2))
        values = signal.lfilter([1.0], [1.0, -2.0 * size * cosine, size**2],
                                rng.standard_normal(n + 2000))[2000:]  # fmt: skip
        return np.asarray(values / values.std())
    if kind == "load steps":
        steps = np.zeros(n)
        for at in rng.integers(0, n, int(rng.integers(3, 15))):
            steps[at:] += rng.standard_normal()
        pole = math.exp(-1.0 / log_uniform(rng, 1.0, 20.0))
        return np.asarray(signal.lfilter([1.0 - pole], [1.0, -pole], steps))
    return _slides(rng, n, int(rng.integers(2, 12))) + red(rng, n, rng.uniform(0.0, 0.3), 10.0)


def _slides(rng: np.random.Generator, n: int, corners: int) -> Floats:
    """Straight lines between levels."""
    at = np.concatenate([[0], np.sort(rng.integers(0, n, corners)), [n]])
    return np.interp(np.arange(n), at, rng.standard_normal(at.size))
