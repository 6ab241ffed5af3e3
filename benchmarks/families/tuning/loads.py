"""Disturbances at the valve, in percent of OP per scan, and counting of a stem's strokes."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["colour", "count_knots", "disturb", "find_strokes"]

Floats = NDArray[np.float64]


@njit(cache=True)
def _first_order(white, pole):  # type: ignore[no-untyped-def]
    out = np.empty_like(white)
    level = 0.0
    for k in range(len(white)):
        level = pole * level + white[k]
        out[k] = level
    return out


def colour(rng: np.random.Generator, scans: int, deviation: float, correlation: float) -> Floats:
    """AR(1) noise of that standard deviation and correlation time in scans."""
    pole = float(np.exp(-1.0 / correlation))
    white = rng.standard_normal(scans) * deviation * np.sqrt(1.0 - pole * pole)
    return np.asarray(_first_order(white, pole))


def disturb(kind: str, rng: np.random.Generator, scans: int, size: float, scale: float) -> Floats:
    """The outside disturbance of that kind of loop; zeros where the kind has none.

    Args:
        kind: of loop.
        rng: source of all choices.
        scans: length.
        size: amplitude in percent.
        scale: time constant of the closed loop in scans, which places periods near or below its
            bandwidth.
    """
    k = np.arange(scans)
    period = float(np.clip(scale * np.exp(rng.uniform(np.log(4.0), np.log(25.0))), 12.0, 250.0))
    phase = rng.uniform(0.0, 1.0)
    if kind == "sine":
        return size * np.sin(2.0 * np.pi * (k / period + phase))
    if kind == "triangle":
        return size * (4.0 * np.abs((k / period + phase) % 1.0 - 0.5) - 1.0)
    if kind == "sines":
        total = np.zeros(scans)
        for _ in range(int(rng.integers(2, 5))):
            ratio = np.exp(rng.uniform(-0.9, 0.9))
            share = rng.uniform(0.3, 0.8)
            total += share * np.sin(2.0 * np.pi * (k / (period * ratio) + rng.uniform()))
        return size * total
    if kind == "load-steps":
        return _steps(rng, scans, size, scale)
    if kind == "ramps":
        knots = np.concatenate([[0], np.cumsum(rng.uniform(40.0, 300.0, scans // 40 + 2))])
        return np.interp(k, knots, size * rng.uniform(-1.0, 1.0, len(knots)))
    if kind == "drift":
        walk = np.cumsum(rng.standard_normal(scans)) / np.sqrt(scans)
        return size * (walk + rng.uniform(-1.0, 1.0) * (k / scans - 0.5) * 2.0)
    if kind == "saturation":
        slow = rng.uniform(150.0, 400.0)
        return size * np.sin(2.0 * np.pi * (k / slow + phase))
    return np.zeros(scans)


def _steps(rng: np.random.Generator, scans: int, size: float, scale: float) -> Floats:
    mean_gap = float(np.clip(8.0 * scale, 40.0, 250.0))
    out = np.zeros(scans)
    at, level = 0, 0.0
    while at < scans:
        gap = int(rng.exponential(mean_gap)) + 15
        out[at : at + gap] = level
        at += gap
        level = size * rng.uniform(-1.0, 1.0)
    return out


@njit(cache=True)
def find_strokes(stem, threshold):  # type: ignore[no-untyped-def]
    """Where the stem's strokes start: travels beyond `threshold` percent between reversals."""
    starts = np.empty(len(stem), dtype=np.int64)
    count = 0
    direction = 0
    extreme, where = stem[0], 0
    low, high, low_at, high_at = stem[0], stem[0], 0, 0
    for k in range(1, len(stem)):
        value = stem[k]
        if direction == 0:
            if value <= low:
                low, low_at = value, k
            if value >= high:
                high, high_at = value, k
            if high - low > threshold:
                direction = 1 if high_at > low_at else -1
                starts[count] = min(low_at, high_at)
                count += 1
                extreme, where = value, k
        elif (value - extreme) * direction >= 0.0:
            extreme, where = value, k
        elif (extreme - value) * direction > threshold:
            starts[count] = where
            count += 1
            direction = -direction
            extreme, where = value, k
    return starts[:count]


def count_knots(signal: Floats) -> int:
    """Count the measured samples of a record that is held or interpolated between them."""
    bend = np.abs(np.diff(signal, 2))
    return int(np.sum(bend > 1e-9 * max(float(np.ptp(signal)), 1e-12)))
