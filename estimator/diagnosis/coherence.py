"""One oscillation in the signals of many loops: complex amplitudes, and how well they agree.

The amplitude of a loop is its signal in a band around the oscillation's frequency, turned back by
that frequency: where two loops swing together, its ratio between them is constant. Loops may be
sampled differently and have gaps. The spectrum of a loop is made once; a band of it costs little.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from estimator.arrays import Array, Mask
from estimator.diagnosis.settings import Grouping
from estimator.window import bridge, carry_on

__all__ = [
    "Agreement",
    "Complex",
    "LoopSignals",
    "LoopSpectrum",
    "agreement",
    "compared_signal",
    "harmonics_of",
    "on_one_grid",
    "spectrum_of",
]

Complex = NDArray[np.complex128]

_FINER = 4
"""Amplitudes for each independent value of a band: straight lines between them then suffice."""
_KNOWN = 0.99
"""Share of a good sample that an amplitude needs: it may not stand in a gap."""


@dataclass(frozen=True, slots=True)
class LoopSignals:
    """The signals of one loop over hours that the loops of a plant have in common.

    ``op``, ``pv``, ``sp`` are ``(n,)``, NaN where bad, ``pv`` and ``sp`` None where not recorded;
    single precision is enough and saves memory where loops are many. ``period`` is the seconds
    between samples, ``start_s`` when the first one was taken.
    """

    op: Array
    pv: Array | None
    sp: Array | None
    period: float
    start_s: float = 0.0


@dataclass(frozen=True, slots=True)
class LoopSpectrum:
    """The spectrum of what a loop is compared by.

    Attributes:
        lines: of the signal and its mirror image, detrended, ``(m,)`` from frequency 0 on.
        power: sums of the lines' power up to each line, ``(m + 1,)``; the last is the whole.
        good: samples that were recorded, ``(n,)``.
        period, start_s: of the samples, seconds.
        step: 1/s from line to line.
        length_s: duration of the transformed signal: mirror image and padding included.
    """

    lines: NDArray[np.complex64]
    power: NDArray[np.float32]
    good: Mask
    period: float
    start_s: float
    step: float
    length_s: float

    @property
    def stop_s(self) -> float:
        """When the last sample was taken."""
        return self.start_s + self.period * (self.good.size - 1)

    def share(self, period: float, width: float) -> float:
        """Share of the motion that is within ``width`` of a period's frequency, 0 to 1."""
        whole = float(self.power[-1])
        if whole <= 0.0:
            return 0.0
        low, high = (
            int(np.clip(round((1.0 + side * width) / period / self.step), 0, self.lines.size))
            for side in (-1.0, 1.0)
        )
        return float(self.power[high] - self.power[low]) / whole

    def amplitudes(self, frequency: float, half: float) -> tuple[Array, Complex]:
        """Times (seconds) and complex amplitudes of the band of that half-width (1/s)."""
        first = max(1, math.ceil((frequency - half) / self.step))
        last = min(self.lines.size - 1, math.floor((frequency + half) / self.step))
        if last < first:
            return np.zeros(0), np.zeros(0, dtype=np.complex128)
        at = np.arange(first, last + 1)
        window = 0.5 + 0.5 * np.cos(math.pi * (at * self.step - frequency) / half)
        size = fft.next_fast_len(_FINER * at.size)
        band = np.zeros(size, dtype=np.complex128)
        band[: at.size] = 2.0 * self.lines[at] * window
        # lines count from the first one of the band: the signal is turned back by it
        values = np.asarray(fft.ifft(band)) * size
        times = np.arange(size) * (self.length_s / size)
        inside = times <= self.period * (self.good.size - 1)
        times, values = times[inside], values[inside]
        values = values * np.exp(2j * math.pi * (first * self.step - frequency) * times)
        turned = values * np.exp(-2j * math.pi * frequency * self.start_s)
        return np.asarray(self.start_s + times, dtype=np.float64), np.asarray(turned)

    def on(self, grid: Array, frequency: float, half: float) -> tuple[Complex, Mask]:
        """Amplitudes at given times, and which of them are known."""
        times, values = self.amplitudes(frequency, half)
        if times.size == 0:
            return np.zeros(grid.size, dtype=np.complex128), np.zeros(grid.size, dtype=bool)
        z = np.interp(grid, times, values.real) + 1j * np.interp(grid, times, values.imag)
        place = (grid - self.start_s) / self.period
        inside = (place >= 0.0) & (place <= self.good.size - 1)
        near = np.interp(place, np.arange(self.good.size), self.good.astype(np.float64))
        return z, inside & (near > _KNOWN)


def compared_signal(one: LoopSignals) -> Array:
    """What the members of a group are compared by: the control error, PV, or OP."""
    if one.pv is None:
        return np.asarray(one.op, dtype=np.float64)
    target = None if one.sp is None else carry_on(one.sp)
    if target is None:
        return np.asarray(one.pv, dtype=np.float64)
    return np.asarray(target - one.pv, dtype=np.float64)


def spectrum_of(one: LoopSignals) -> LoopSpectrum:
    """The spectrum of a loop's compared signal."""
    raw = compared_signal(one)
    x = bridge(raw)
    k = np.arange(x.size)
    x = x - np.polyval(np.polyfit(k, x, 1), k)
    padded = fft.next_fast_len(2 * x.size, real=True)
    lines = np.asarray(fft.rfft(np.concatenate([x, x[::-1]]), padded)) / padded
    power = np.concatenate([[0.0], np.cumsum(np.abs(lines) ** 2)]).astype(np.float32)
    return LoopSpectrum(
        lines=lines.astype(np.complex64),
        power=power,
        good=np.isfinite(raw),
        period=one.period,
        start_s=one.start_s,
        step=1.0 / (padded * one.period),
        length_s=padded * one.period,
    )


@dataclass(frozen=True, slots=True)
class Agreement:
    """How well two loops swing together.

    Attributes:
        coherence: 0 to 1, at the best of the delays that were tried.
        free: independent values on which it rests: few for two steady sines, whose coherence says
            no more than that their periods agree.
    """

    coherence: float
    free: float

    def chance(self) -> float:
        """Logarithm of the probability that loops which do not belong together agree as well."""
        if not 0.0 < self.coherence < 1.0:
            return 0.0
        return (self.free - 1.0) * math.log1p(-(self.coherence**2))


def agreement(
    one: LoopSpectrum, other: LoopSpectrum, period: float, width: float, delays: Array
) -> Agreement:
    """Compare two loops in the band of ``width`` (a share) around a period.

    Args:
        one, other: their spectra.
        period: seconds.
        width: half of the band's width over its frequency.
        delays: of the other behind the one, in periods, ``(m,)``.
    """
    nothing = Agreement(0.0, 1.0)
    half = width / period
    start, stop = max(one.start_s, other.start_s), min(one.stop_s, other.stop_s)
    if stop - start < 4.0 * period:
        return nothing
    grid = np.arange(start, stop, 0.25 / half)
    x, known = one.on(grid, 1.0 / period, half)
    best = nothing
    for delay in delays:
        y, both = other.on(grid + delay * period, 1.0 / period, half)
        both &= known
        count = int(both.sum())
        if count < 6:
            continue
        a, b = np.where(both, x, 0.0), np.where(both, y, 0.0)
        power = float(np.sum(np.abs(a) ** 2) * np.sum(np.abs(b) ** 2))
        if power <= 0.0:
            continue
        found = min(1.0, float(abs(np.sum(a * np.conj(b)))) / math.sqrt(power))
        if found > best.coherence:
            p, q = (np.abs(np.asarray(fft.fft(v))) ** 2 for v in (a, b))
            shared = float(np.sum(p * q)) / float(np.sum(p) * np.sum(q))
            best = Agreement(found, max(1.0, 1.0 / shared))
    return best


def harmonics_of(one: LoopSpectrum, period: float, width: float) -> float:
    """Amplitude of the second and third harmonic over the first, PV's own; 0 where too fast."""
    sizes = []
    for h in (1, 2, 3):
        if h / period > 0.4 / one.period:
            sizes.append(0.0)
            continue
        _, z = one.amplitudes(h / period, width / period)
        sizes.append(math.sqrt(float(np.mean(np.abs(z) ** 2))) if z.size else 0.0)
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
        known = np.interp(grid, times, np.isfinite(raw).astype(float)) > _KNOWN
        found[name] = np.where(known, values - values.mean(), np.nan)
    return found
