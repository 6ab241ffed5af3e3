"""One oscillation in the signals of many loops: complex amplitudes, and how well they agree.

The amplitude of a loop is its signal in a narrow band around the oscillation's frequency, turned
back by that frequency: where two loops swing together, its ratio between them is constant. Loops
may be sampled differently and have gaps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from estimator.arrays import Array, Mask
from estimator.diagnosis.oscillation import bridge
from estimator.diagnosis.settings import Grouping

__all__ = [
    "LoopSignals",
    "amplitudes",
    "coherence",
    "common_grid",
    "compared_signal",
    "harmonics_of",
    "on_one_grid",
    "share_in_band",
]

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class LoopSignals:
    """The signals of one loop over hours that the loops of a plant have in common.

    ``op``, ``pv``, ``sp`` are ``(n,)``, NaN where bad, ``pv`` and ``sp`` None where not recorded;
    ``period`` is the seconds between samples, ``start_s`` when the first one was taken.
    """

    op: Array
    pv: Array | None
    sp: Array | None
    period: float
    start_s: float = 0.0


def compared_signal(one: LoopSignals) -> Array:
    """What the members of a group are compared by: the control error, PV, or OP."""
    if one.pv is None:
        return np.asarray(one.op, dtype=np.float64)
    if one.sp is None or not np.isfinite(one.sp).any():
        return np.asarray(one.pv, dtype=np.float64)
    return np.asarray(one.sp - one.pv)


def amplitudes(
    one: LoopSignals, frequency: float, grid: Array, width: float, harmonic: int = 1
) -> tuple[Complex, Mask]:
    """Complex amplitudes at the times of ``grid`` of the band around a frequency (1/s)."""
    raw = compared_signal(one)
    good = np.isfinite(raw)
    x = bridge(raw)
    k = np.arange(x.size)
    x = x - np.polyval(np.polyfit(k, x, 1), k)
    n = x.size
    padded = fft.next_fast_len(2 * n)
    spectrum = np.asarray(fft.fft(np.concatenate([x, x[::-1]]), padded))
    f = np.asarray(fft.fftfreq(padded, one.period))
    half = width * frequency
    away = np.abs(f - harmonic * frequency)
    window = np.where(away < half, 0.5 + 0.5 * np.cos(math.pi * away / half), 0.0)
    band = np.asarray(fft.ifft(2.0 * spectrum * window))[:n]
    times = one.start_s + one.period * k
    turned = band * np.exp(-2j * math.pi * harmonic * frequency * times)
    inside = (grid >= times[0]) & (grid <= times[-1])
    z = np.interp(grid, times, turned.real) + 1j * np.interp(grid, times, turned.imag)
    known = inside & (np.interp(grid, times, good.astype(float)) > 0.99)
    return z, known


def common_grid(signals: Mapping[str, LoopSignals], period: float) -> Array:
    """Times at which amplitudes are compared: the hours that any two loops have, a period apart."""
    start = min(one.start_s for one in signals.values())
    stop = max(one.start_s + one.period * one.op.size for one in signals.values())
    return np.arange(start, stop, 0.5 * period)


def coherence(a: Complex, b: Complex, both: Mask) -> tuple[float, float]:
    """Coherence of two amplitudes, and the number of values it rests on."""
    if int(both.sum()) < 4:
        return 0.0, 0.0
    x, y = a[both], b[both]
    power = float(np.sum(np.abs(x) ** 2) * np.sum(np.abs(y) ** 2))
    if power <= 0.0:
        return 0.0, 0.0
    return float(abs(np.sum(x * np.conj(y)))) / math.sqrt(power), float(both.sum())


def share_in_band(one: LoopSignals, period: float) -> float:
    """Share of the loop's motion in the narrow band."""
    grid = np.arange(one.start_s, one.start_s + one.period * one.op.size, 0.5 * period)
    z, known = amplitudes(one, 1.0 / period, grid, 0.2)
    whole = float(np.nanvar(compared_signal(one)))
    return (
        0.5 * float(np.mean(np.abs(z[known]) ** 2)) / whole if whole > 0.0 and known.any() else 0.0
    )


def harmonics_of(one: LoopSignals, period: float, width: float) -> float:
    """Amplitude of the second and third harmonic over the first, PV's own; 0 where too fast."""
    grid = np.arange(one.start_s, one.start_s + one.period * one.op.size, 0.5 * period)
    sizes = []
    for h in (1, 2, 3):
        if h / period > 0.4 / one.period:
            sizes.append(0.0)
            continue
        z, known = amplitudes(one, 1.0 / period, grid, width, h)
        sizes.append(abs(float(np.mean(np.abs(z[known])))) if known.any() else 0.0)
    return math.hypot(sizes[1], sizes[2]) / sizes[0] if sizes[0] > 0.0 else 0.0


def on_one_grid(
    names: tuple[str, ...],
    signals: Mapping[str, LoopSignals],
    period: float,
    grouping: Grouping,
) -> dict[str, Array]:
    """The signals at common times, some a period; NaN in their gaps."""
    chosen = {name: signals[name] for name in names}
    start = max(one.start_s for one in chosen.values())
    stop = min(one.start_s + one.period * one.op.size for one in chosen.values())
    step = max(period / grouping.per_period, *(one.period for one in chosen.values()))
    grid = np.arange(start, stop, step)
    found = {}
    for name, one in chosen.items():
        raw = compared_signal(one)
        times = one.start_s + one.period * np.arange(raw.size)
        values = np.interp(grid, times, bridge(raw))
        known = np.interp(grid, times, np.isfinite(raw).astype(float)) > 0.99
        found[name] = np.where(known, values - values.mean(), np.nan)
    return found
