"""Loads, noises and set points of the report family, each an array of shape ``(n,)``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

__all__ = [
    "coloured",
    "drift",
    "load_steps",
    "measurement_noise",
    "ramps",
    "set_point_steps",
    "sine",
    "sines",
    "triangle",
]

Array = NDArray[np.float64]
Rng = np.random.Generator


def coloured(rng: Rng, n: int, correlation: float) -> Array:
    """First-order noise of variance one; ``correlation`` is its time constant in scans."""
    pole = float(np.exp(-1.0 / max(correlation, 1e-6)))
    white = rng.standard_normal(n)
    white[0] /= np.sqrt(1.0 - pole**2)
    return np.asarray(np.sqrt(1.0 - pole**2) * lfilter([1.0], [1.0, -pole], white))


def sine(rng: Rng, n: int, period: float) -> Array:
    """Sinusoid of amplitude one whose phase and amplitude wander, as those of a machine do."""
    wander = 0.15 * coloured(rng, n, 8.0 * period)
    size = 1.0 + rng.uniform(0.0, 0.15) * coloured(rng, n, 6.0 * period)
    phase = rng.uniform(0.0, 2.0 * np.pi) + wander
    return np.asarray(size * np.sin(2.0 * np.pi * np.arange(n) / period + phase))


def triangle(rng: Rng, n: int, period: float) -> Array:
    """Triangular or saw-toothed wave of amplitude one, its corners a little uneven."""
    rising = rng.uniform(0.2, 0.8)
    ends = np.cumsum(period * (1.0 + 0.06 * rng.standard_normal(2 + int(1.5 * n / period))))
    ends -= rng.uniform(0.0, 1.0) * period + period
    low, high = -1.0, 1.0
    at = np.column_stack([ends[:-1], ends[:-1] + rising * np.diff(ends)]).ravel()
    level = np.tile([low, high], ends.size - 1)
    level = level * (1.0 + 0.05 * rng.standard_normal(level.size))
    return np.asarray(np.interp(np.arange(n), at, level))


def sines(rng: Rng, n: int, period: float) -> Array:
    """Two to four sinusoids without a common period; together about amplitude one."""
    count = int(rng.integers(2, 5))
    total = np.zeros(n)
    for i in range(count):
        stretch = 1.0 if i == 0 else float(np.exp(rng.uniform(-1.2, 1.2)))
        total += rng.uniform(0.4, 1.0) * sine(rng, n, period * stretch)
    return total / np.sqrt(count)


def load_steps(rng: Rng, n: int, gap: float) -> Array:
    """Steps at random times, ``gap`` scans apart on average; standard deviation near one."""
    times = rng.random(n) < 1.0 / gap
    levels = rng.standard_normal(int(times.sum()) + 1)
    steps = levels[np.cumsum(times)]
    return np.asarray(lfilter([0.5], [1.0, -0.5], steps - steps[0]) + steps[0])


def ramps(rng: Rng, n: int, gap: float) -> Array:
    """Straight pieces between random corners, ``gap`` scans apart on average."""
    corners = np.cumsum(rng.exponential(gap, 4 + int(3 * n / gap))) - gap
    return np.asarray(np.interp(np.arange(n), corners, rng.standard_normal(corners.size)))


def drift(rng: Rng, n: int) -> Array:
    """A slow trend: part straight, part daily swing, part random walk; about one at its end."""
    time = np.linspace(0.0, 1.0, n)
    walk = np.cumsum(rng.standard_normal(n)) / np.sqrt(n)
    swing = np.sin(2.0 * np.pi * (rng.uniform(0.3, 1.2) * time + rng.random()))
    return np.asarray(rng.choice([-1.0, 1.0]) * time + 0.5 * walk + 0.4 * swing)


def set_point_steps(rng: Rng, n: int, gap: float) -> Array:
    """Set points that an operator moves now and then, some by ramp; moves of about one."""
    times = np.flatnonzero(rng.random(n) < 1.0 / gap)
    target = np.zeros(n)
    level = 0.0
    for at in times:
        change = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 1.3))
        if abs(level + change) > 1.6:
            change = -change
        level += change
        target[at:] = level
    if rng.random() < 0.3:
        fastest = 1.0 / rng.uniform(5.0, 40.0)
        out, now = np.empty(n), 0.0
        for k in range(n):
            now += min(max(target[k] - now, -fastest), fastest)
            out[k] = now
        return out
    return target


def measurement_noise(rng: Rng, n: int) -> Array:
    """Noise of a transmitter, standard deviation about one: white, coloured or with outliers."""
    which = rng.random()
    if which < 0.45:
        return np.asarray(rng.standard_normal(n))
    if which < 0.75:
        share = rng.uniform(0.3, 0.9)
        slow = coloured(rng, n, float(np.exp(rng.uniform(0.0, 2.5))))
        return np.asarray(np.sqrt(share) * slow + np.sqrt(1.0 - share) * rng.standard_normal(n))
    if which < 0.9:
        return np.asarray(rng.standard_t(4.0, n) / np.sqrt(2.0))
    spikes = (rng.random(n) < 0.004) * rng.standard_normal(n) * 6.0
    return np.asarray(rng.standard_normal(n) + spikes)
