"""What the indices share: the door, detrending and correlation with bad samples left out."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from estimator.outcomes import EstimatorError

Array = NDArray[np.float64]

LEAST_SAMPLES = 20
"""Fewer show no correlation: its deviation is one over the root of their number."""


def vector(name: str, samples: ArrayLike) -> Array:
    """A checked vector of at least `LEAST_SAMPLES` usable samples; NaN stays."""
    values = np.asarray(samples, dtype=np.float64)
    if values.ndim != 1:
        raise EstimatorError(f"{name} must be a vector; got shape {values.shape}")
    if np.isinf(values).any():
        raise EstimatorError(f"{name} holds an infinity; mark bad samples with NaN")
    usable = int(np.isfinite(values).sum())
    if usable < LEAST_SAMPLES:
        raise EstimatorError(
            f"{name} has {usable} usable samples, an index needs {LEAST_SAMPLES} or more"
        )
    return values


def pair(op: ArrayLike, pv: ArrayLike) -> tuple[Array, Array]:
    """OP and PV of one length, both NaN where either is bad."""
    u, y = vector("op", op), vector("pv", pv)
    if u.shape != y.shape:
        raise EstimatorError(f"op and pv must have one length; got {u.size} and {y.size}")
    bad = np.isnan(u) | np.isnan(y)
    u, y = np.where(bad, np.nan, u), np.where(bad, np.nan, y)
    return vector("op with pv", u), y


def detrended(values: Array) -> Array:
    """The signal less its straight line; bad samples become 0, the value that says nothing."""
    good = np.isfinite(values)
    time = np.arange(values.size, dtype=np.float64)
    slope, level = np.polyfit(time[good], values[good], 1)
    rest: Array = np.where(good, values - (slope * time + level), 0.0)
    # What is left of a straight line is rounding, and rounding must not be taken for a signal.
    floor = 1e-12 * max(1.0, float(np.abs(values[good]).max()))
    if np.abs(rest).max() <= floor:
        return np.zeros_like(rest)
    return rest


def correlation(u: Array, y: Array) -> tuple[Array, Array]:
    """Lags and normalised cross-correlation; a positive lag compares ``u`` with a later ``y``.

    The same bits as those of `scipy.signal.correlate`, whose module takes half a second to load,
    in every process that judges a window.
    """
    scale = float(np.sqrt(np.dot(u, u) * np.dot(y, y)))
    lags = np.arange(1.0 - u.size, y.size)
    if scale == 0.0:
        return lags, np.zeros(lags.size)
    size = fft.next_fast_len(lags.size, real=True)
    products = fft.irfft(fft.rfft(y, size) * fft.rfft(u[::-1], size), size)
    return lags, np.asarray(products)[: lags.size] / scale


def crossings(values: Array) -> Array:
    """Where a signal crosses zero, in samples from its start, by linear interpolation."""
    left, right = values[:-1], values[1:]
    at = np.flatnonzero((left > 0.0) != (right > 0.0))
    return np.asarray(at + left[at] / (left[at] - right[at]), dtype=np.float64)
