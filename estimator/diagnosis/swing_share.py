"""How much of what moves is an oscillation, its harmonics included."""

from __future__ import annotations

import math

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.settings import Swinging

__all__ = ["local_share"]


def local_share(power: Array, n: int, period: float, settings: Swinging) -> float:
    """Share of an oscillation, of any shape, in all that is not slower than a trend, 0 to 1.

    White noise is no motion: its level, that of the fastest half of the spectrum, is taken off. Nor
    is what a drift has in the oscillation's own band part of the oscillation: a smooth spectrum is
    as high on one side of the band, and an oscillation's is higher than on both.

    Args:
        power: spectrum of ``n`` samples under a Hann window, ``(n // 2 + 1,)``.
        n: samples.
        period: of the oscillation, samples.
        settings: see `estimator.diagnosis.settings`.
    """
    cycles = np.arange(power.size) / n * period
    white = _noise_level(power[power.size // 2 :])
    motion = power - white
    is_fast = cycles > 1.0 / settings.trend
    octaves = np.abs(np.log2(np.maximum(cycles, np.finfo(np.float64).tiny)))
    is_near = octaves < settings.local
    near = float(motion[is_near].sum())
    # no less than white noise leaves by chance
    chance = settings.chance * white * math.sqrt(_OVERLAP * float(is_fast.sum()))
    fast = max(float(motion[is_fast].sum()), near, chance)
    beside = int(is_near.sum()) * max(0.0, _level_beside(power, cycles, octaves, settings) - white)
    whole = max(0.0, near - beside) + _harmonic_power(power, cycles, settings)
    return min(1.0, max(0.0, whole / fast)) if fast > 0.0 else 0.0


_OVERLAP = 1.94
"""Variance of a sum of a Hann window's powers over that of independent ones: neighbours are alike
(correlations of 4/9 and 1/36 on each side)."""


def _noise_level(power: Array) -> float:
    """Mean power of noise, exponentially distributed, so that single peaks move it little."""
    return float(np.median(power)) / math.log(2.0)


def _level_beside(power: Array, cycles: Array, octaves: Array, settings: Swinging) -> float:
    """Level on the lower side of an oscillation's band; 0 where a side holds no line."""
    is_beside = (octaves >= settings.local) & (octaves < settings.local + settings.beside)
    below, above = power[is_beside & (cycles < 1.0)], power[is_beside & (cycles > 1.0)]
    if not (below.size and above.size):
        return 0.0
    return min(_noise_level(below), _noise_level(above))


def _harmonic_power(power: Array, cycles: Array, settings: Swinging) -> float:
    """Power at the multiples of a frequency beyond that between them, as far as it is no chance.

    ``cycles`` is the frequency over the oscillation's, ``(m,)``. Pulses have most of their power
    there. Of smooth spectra the quarter on each side of a multiple holds as much as the rest.
    """
    # whole orders only: a part of one would hold more of one kind
    highest = math.floor(cycles[-1] - 0.5) + 0.5
    multiples = (cycles >= 1.5) & (cycles < highest)
    is_near = np.abs(cycles - np.round(cycles)) < 0.25
    between = power[multiples & ~is_near]
    excess = float(power[multiples & is_near].sum() - between.sum())
    chance = math.sqrt(2.0 * _OVERLAP * float(np.sum(between**2)))
    return max(0.0, excess - settings.chance * chance)
