"""What PV may hold beside the valve's work: the same offers to the healthy and the sticky valve.

Each is paid for by BIC, its place included: a frequency or an amplitude more that was looked for
costs as much as one that was known is worth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from compiled import kernel
from estimator.algebra import dot
from estimator.arrays import Array, Index
from estimator.processes.poles import Poles

__all__ = [
    "FEWEST_CYCLES",
    "Characteristic",
    "Nuisance",
    "Sinusoid",
    "columns_of",
    "price_of",
    "sine_and_cosine",
    "spectral_peaks",
]


class Nuisance(Protocol):
    """One more thing in PV, of unknown size."""

    def columns(self, stem: Array, poles: Poles, dead_time: int) -> Array:
        """Signals in PV, ``(m, n)``, for this stem and process."""
        ...

    def price(self, rows: float) -> float:
        """What the hypothesis pays for it, in nats, on so many judged rows."""
        ...


FEWEST_CYCLES = 1.5
"""An oscillation of fewer cycles in the window is a drift."""
_NEAR = 3
"""Bins of a spectrum that one peak takes."""
_BLOCK = 64
"""Samples that share one pair of the (slow) sine and cosine."""


@lru_cache(maxsize=64)
def _waves(cycles: float, harmonics: tuple[int, ...], n: int) -> Array:
    """Sine and cosine of every harmonic, ``(2 m, n)``; the fits of one wave ask for it often."""
    angle = 2.0 * math.pi * cycles / n
    found: Array = _multiples(angle, n, np.array(harmonics))
    found.flags.writeable = False
    return found


@kernel
def _multiples(angle: float, n: int, harmonics: Index) -> Array:
    """Sine and cosine rows ``(2 m, n)`` of multiples of an angle a sample, in rising order.

    Each multiple is the one before, turned by the angle of the first once more.
    """
    out = np.empty((2 * harmonics.size, n))
    s, c = np.empty(n), np.empty(n)
    first_s, first_c = np.empty(_BLOCK), np.empty(_BLOCK)
    for i in range(_BLOCK):
        first_s[i], first_c[i] = math.sin(angle * i), math.cos(angle * i)
    for begin in range(0, n, _BLOCK):
        x, y = math.sin(angle * begin), math.cos(angle * begin)
        for i in range(min(_BLOCK, n - begin)):
            s[begin + i] = x * first_c[i] + y * first_s[i]
            c[begin + i] = y * first_c[i] - x * first_s[i]
    sine, cosine = np.zeros(n), np.ones(n)
    at = 0
    for i in range(harmonics.size):
        while at < harmonics[i]:
            for k in range(n):
                x, y = sine[k], cosine[k]
                sine[k], cosine[k] = x * c[k] + y * s[k], y * c[k] - x * s[k]
            at += 1
        out[2 * i], out[2 * i + 1] = sine, cosine
    return out


@kernel
def sine_and_cosine(cycles: float, n: int) -> Array:
    """The rows ``(2, n)`` of a sinusoid of so many cycles in the window."""
    return _multiples(2.0 * math.pi * cycles / n, n, np.ones(1, np.int64))


@dataclass(frozen=True, slots=True)
class Sinusoid:
    """An oscillation from outside: ``cycles`` in the window, with the given ``harmonics``.

    ``(1,)`` is a sine, ``(1, 2, 3)`` a wave of any shape, odd ones one that is alike up and down,
    as a triangle or the cycle of a neighbour with a sticky valve.
    """

    cycles: float
    harmonics: tuple[int, ...] = (1,)

    def columns(self, stem: Array, poles: Poles, dead_time: int) -> Array:
        """Sine and cosine of every harmonic."""
        del poles, dead_time
        return _waves(self.cycles, self.harmonics, stem.size)

    def price(self, rows: float) -> float:
        """Two sizes a harmonic, and the frequency, whose standard error falls with ``n^(3/2)``."""
        return (1.5 + len(self.harmonics)) * math.log(rows)


@dataclass(frozen=True, slots=True)
class Characteristic:
    """A curved installed characteristic: the stem's square and cube go through the process too."""

    def columns(self, stem: Array, poles: Poles, dead_time: int) -> Array:
        """Responses to the centred square and cube of the stem."""
        n = stem.size
        ones = np.ones(n)
        z = stem - dot(stem, ones) / n
        found = np.zeros((2, n))
        for row, power in enumerate((2, 3)):
            signal = z**power
            response = poles.response(signal - dot(signal, ones) / n)
            found[row, dead_time:] = response[: n - dead_time]
        return found

    def price(self, rows: float) -> float:
        """Two sizes."""
        return math.log(rows)

    @staticmethod
    def is_monotonic(stem: Array, gain: float, square: float, cube: float) -> bool:
        """Whether ``gain z + square z^2 + cube z^3`` never turns back within the stem's travel.

        No valve opens and passes less: a curve that turns back is not a characteristic.
        """
        z = stem - dot(stem, np.ones(stem.size)) / stem.size
        at = [float(z.min()), float(z.max())]
        if cube != 0.0 and at[0] < (turn := -square / (3.0 * cube)) < at[1]:
            at.append(turn)
        return all((gain + 2.0 * square * x + 3.0 * cube * x * x) * gain > 0.0 for x in at)


def columns_of(
    nuisances: tuple[Nuisance, ...], stem: Array, poles: Poles, dead_time: int
) -> list[Array]:
    """The columns of all nuisances, one array each."""
    return [one.columns(stem, poles, dead_time) for one in nuisances]


def price_of(nuisances: tuple[Nuisance, ...], rows: float) -> float:
    """What all of them cost, in nats."""
    return math.fsum(one.price(rows) for one in nuisances)


def spectral_peaks(signal: Array, count: int) -> list[float]:
    """Cycles in the window of the highest peaks of the spectrum, Hann window, interpolated."""
    n = signal.size
    centred = signal - dot(signal, np.ones(n)) / n
    spectrum = np.abs(np.fft.rfft(centred * np.hanning(n)))
    found = []
    for _ in range(count):
        k = 1 + int(spectrum[1:-1].argmax())
        left, middle, right = (float(spectrum[i]) for i in (k - 1, k, k + 1))
        bend = left - 2.0 * middle + right
        found.append(k + (0.5 * (left - right) / bend if bend < 0.0 else 0.0))
        spectrum[max(0, k - _NEAR) : k + _NEAR + 1] = 0.0
    return found
