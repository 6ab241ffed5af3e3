"""Compiled arithmetic of a scan: what numpy needs dozens of small arrays for."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["carried_covariance", "coloured_power", "correlate", "held_course"]

Array = NDArray[np.float64]


@numba.njit("float64[::1](float64[:, ::1], float64[::1], float64[::1], float64)", cache=True)
def held_course(free: Array, held: Array, state: Array, drive: float) -> Array:
    """Return ``free @ state + held * drive``."""
    course = held * drive
    for i in range(course.size):
        for j in range(state.size):
            course[i] += free[i, j] * state[j]
    return course


@numba.njit(
    "Tuple((float64, float64[::1]))(float64[:, ::1], float64[::1], float64[::1])", cache=True
)
def correlate(weighted: Array, weights: Array, error: Array) -> tuple[float, Array]:
    """Return the weighted square of ``error`` and ``weighted @ error``."""
    square = 0.0
    for k in range(error.size):
        square += weights[k] * error[k] * error[k]
    correlation = np.zeros(weighted.shape[0])
    for i in range(weighted.shape[0]):
        for k in range(error.size):
            correlation[i] += weighted[i, k] * error[k]
    return square, correlation


@numba.njit("float64(float64[::1], float64)", cache=True)
def coloured_power(lags: Array, colour: float) -> float:
    """Return the variance that noise with an autocorrelation of ``colour**k`` makes behind a
    filter with the autocovariance ``lags``.
    """
    total = 0.0
    for k in range(lags.size - 1, 0, -1):
        total = colour * (lags[k] + total)
    return float(lags[0] + 2.0 * total)


@numba.njit(
    "float64[:, ::1](float64[:, ::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[::1],"
    " float64, float64)",
    cache=True,
)
def carried_covariance(
    covariance: Array,
    A: Array,
    gain: Array,
    q: Array,
    cross: Array,
    scale: float,
    noise: float,
) -> Array:
    """Return ``F P F' + scale q + noise g g' - scale (c g' + g c')`` with ``F = A`` less the gain
    ``g`` in its first column: Joseph's form, right for any gain.
    """
    n = gain.size
    F = A.copy()
    for i in range(n):
        F[i, 0] -= gain[i]
    half = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            if F[i, k] != 0.0:
                for j in range(n):
                    half[i, j] += F[i, k] * covariance[k, j]
    out = np.empty((n, n))
    for i in range(n):
        for j in range(i, n):
            value = noise * gain[i] * gain[j] + scale * (
                q[i, j] - cross[i] * gain[j] - cross[j] * gain[i]
            )
            for k in range(n):
                value += half[i, k] * F[j, k]
            out[i, j] = out[j, i] = value
    return out
