"""Is an oscillation the cycle of something nonlinear, or what noise makes of a linear loop?

    nonlinearity_index(error, period=40.0)

A signal is told from its own past: by what followed the stretches that were most like the last one.
Signals with the same spectrum and random phases are told as badly as a linear system with noise. If
the signal itself is told better than they are by three of their standard deviations, the index
exceeds 1 and something nonlinear swings: a limit cycle, or a wave that is no sine.

Source: Theiler et al. (1992), "Testing for nonlinearity in time series: the method of surrogate
data", Physica D 58, 77-94; the index, its horizon of one period and its limit of 1: Thornhill
(2005), "Finding the source of nonlinearity in a process with plant-wide oscillation", IEEE
Transactions on Control Systems Technology 13, 434-443.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import fft, signal

from estimator.diagnosis.settings import DIAGNOSIS, Surrogates
from estimator.lanes import Array

__all__ = ["nonlinearity_index"]


def nonlinearity_index(
    values: Array, period: float, settings: Surrogates = DIAGNOSIS.surrogates
) -> float:
    """Distance to signals of the same spectrum, in three of their standard deviations.

    Args:
        values: samples without holes, ``(n,)``.
        period: of the oscillation, samples.
        settings: see `estimator.diagnosis.settings`.

    Returns:
        Above 1 for a nonlinear source; NaN where the record is too short or too coarse.
    """
    every = max(1, round(period / settings.per_period))
    thinned = values[: values.size // every * every].reshape(-1, every).mean(axis=1)
    x = _ends_joined(thinned[-settings.rows :], max(1, round(period / every)))
    length = round(period / every)
    if length < settings.least_per_period or x.size < settings.least_periods * length:
        return math.nan
    x = np.asarray(signal.detrend(x))
    if float(np.std(x)) == 0.0:
        return math.nan
    rng = np.random.default_rng(0)
    own = _prediction_error(x, length, settings.neighbours)
    others = [
        _prediction_error(_surrogate(x, rng), length, settings.neighbours)
        for _ in range(settings.count)
    ]
    spread = float(np.std(others, ddof=1))
    return (float(np.mean(others)) - own) / (3.0 * spread) if spread > 0.0 else math.nan


def _ends_joined(x: Array, period: int) -> Array:
    """The signal without less than a period, so that its end leads over to its beginning."""
    if x.size < 3 * period:
        return x
    head, scale = x[: period + 1], float(np.std(x)) or 1.0
    tail = x[-period - 1 :]
    level = np.abs(tail[None, 1:] - head[:-1, None])
    slope = np.abs(np.diff(tail)[None, :] - np.diff(head)[:, None])
    first, last = np.unravel_index(int(np.argmin((level + slope) / scale)), level.shape)
    return x[int(first) : x.size - period + int(last)]


def _surrogate(x: Array, rng: np.random.Generator) -> Array:
    """A signal of the same spectrum with random phases."""
    lines = np.asarray(fft.rfft(x))
    turned = lines * np.exp(2j * math.pi * rng.random(lines.size))
    turned[0] = lines[0]
    return np.asarray(fft.irfft(turned, x.size))


def _prediction_error(x: Array, length: int, neighbours: int) -> float:
    """Root mean square error of telling a sample from the stretches most like the one before."""
    stretches = np.lib.stride_tricks.sliding_window_view(x[:-length], length)
    follows = x[2 * length - 1 :]
    size = np.sum(stretches**2, axis=1)
    apart = size[:, None] + size[None, :] - 2.0 * (stretches @ stretches.T)
    at = np.arange(size.size)
    # stretches that overlap are alike whatever the signal
    apart[np.abs(at[:, None] - at[None, :]) < length] = np.inf
    nearest = np.argpartition(apart, neighbours, axis=1)[:, :neighbours]
    told = follows[nearest].mean(axis=1)
    return float(np.sqrt(np.mean((follows - told) ** 2)))
