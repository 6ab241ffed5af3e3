"""How much of what moves is an oscillation, its harmonics included."""

from __future__ import annotations

import math

import numpy as np

from estimator.arrays import Array
from estimator.diagnosis.settings import Swinging

__all__ = ["local_share"]


def local_share(power: Array, n: int, period: float, settings: Swinging) -> float:
    """Share of an oscillation, of any shape, in all that is not slower than a trend, 0 to 1.

    White noise is no motion: its level, that of the fastest half of the spectrum, is taken off.

    Args:
        power: spectrum of ``n`` samples under a Hann window, ``(n // 2 + 1,)``.
        n: samples.
        period: of the oscillation, samples.
        settings: see `estimator.diagnosis.settings`.
    """
    cycles = np.arange(power.size) / n * period
    # the powers of white noise are distributed exponentially
    white = float(np.median(power[power.size // 2 :])) / math.log(2.0)
    motion = power - white
    is_fast = cycles > 1.0 / settings.trend
    half = 2.0**settings.local
    near = float(motion[(cycles > 1.0 / half) & (cycles < half)].sum())
    # no less than white noise leaves by chance
    chance = settings.chance * white * math.sqrt(_OVERLAP * float(is_fast.sum()))
    fast = max(float(motion[is_fast].sum()), near, chance)
    whole = near + _harmonic_power(power, cycles, settings)
    return min(1.0, max(0.0, whole / fast)) if fast > 0.0 else 0.0


_OVERLAP = 1.94
"""Variance of a sum of a Hann window's powers over that of independent ones: neighbours are alike
(correlations of 4/9 and 1/36 on each side)."""


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
