"""Compiled arithmetic of a scan: what numpy needs dozens of small arrays for.

Sums are taken in the order that is written here, without fast arithmetic and without BLAS: the same
bits on every processor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from compiled import kernel_for

__all__ = [
    "coloured_power",
    "correlate",
    "gram_of",
    "held_course",
    "lagged_products",
    "multiplied",
    "next_state",
    "process_answer",
    "step_response_of",
    "weighted_mean",
    "weighted_spread",
]

Array = NDArray[np.float64]


@kernel_for("float64[::1](float64[:, ::1], float64[::1], float64[::1], float64)")
def held_course(free: Array, held: Array, state: Array, drive: float) -> Array:
    """Return ``free @ state + held * drive``."""
    course = held * drive
    for i in range(course.size):
        for j in range(state.size):
            course[i] += free[i, j] * state[j]
    return course


@kernel_for("Tuple((float64, float64[::1]))(float64[:, ::1], float64[::1], float64[::1])")
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


@kernel_for("float64[::1](float64[:, ::1], float64[::1])")
def multiplied(matrix: Array, vector: Array) -> Array:
    """Return ``matrix @ vector``."""
    out = np.zeros(matrix.shape[0])
    for i in range(matrix.shape[0]):
        for j in range(vector.size):
            out[i] += matrix[i, j] * vector[j]
    return out


@kernel_for("float64[::1](float64[:, ::1], float64[::1])")
def next_state(A: Array, state: Array) -> Array:
    """Return ``A @ state`` for ``A`` in observer form: beside its first column it moves each state
    to the one before. Of a longer ``state`` the first ``A.shape[0]`` elements count.
    """
    n = A.shape[0]
    out = np.empty(n)
    for i in range(n):
        out[i] = A[i, 0] * state[0]
        if i + 1 < n:
            out[i] += state[i + 1]
    return out


@kernel_for("float64[::1](float64[:, ::1], float64[::1], int64)")
def step_response_of(A: Array, B: Array, samples: int) -> Array:
    """Return the first state at 1, 2, ... ``samples`` samples after a unit step of the input; ``A``
    as in `next_state`.
    """
    state = np.zeros(B.size)
    response = np.empty(samples)
    for k in range(samples):
        state = next_state(A, state)
        for i in range(B.size):
            state[i] += B[i]
        response[k] = state[0]
    return response


@kernel_for("float64[::1](float64[::1], float64[::1], float64[::1])")
def process_answer(b: Array, a: Array, drive: Array) -> Array:
    """Return what a process ``b/(1 + a)`` (the leading 1 left out of ``a``) makes of a drive, from
    rest: the transposed direct form II of `scipy.signal.lfilter`, whose module takes longer to load
    than the rest of a compensator.
    """
    order = max(a.size, b.size - 1)
    zeros = np.zeros(order + 1)
    zeros[: b.size] = b
    poles = np.zeros(order)
    poles[: a.size] = a
    state = np.zeros(order + 1)
    answer = np.empty(drive.size)
    for k in range(drive.size):
        x = drive[k]
        y = state[0] + zeros[0] * x
        for i in range(order):
            state[i] = state[i + 1] + x * zeros[i + 1] - y * poles[i]
        answer[k] = y
    return answer


@kernel_for("float64[:, ::1](float64[:, ::1], float64[:, ::1])")
def gram_of(left: Array, right: Array) -> Array:
    """Return ``left @ right.T``."""
    out = np.zeros((left.shape[0], right.shape[0]))
    for i in range(left.shape[0]):
        for j in range(right.shape[0]):
            for k in range(left.shape[1]):
                out[i, j] += left[i, k] * right[j, k]
    return out


@kernel_for("float64[::1](float64[::1])")
def lagged_products(signal: Array) -> Array:
    """Return the sums of ``signal[i] * signal[i + lag]`` for lag 0, 1, ... ``signal.size - 1``."""
    out = np.zeros(signal.size)
    for lag in range(signal.size):
        for i in range(signal.size - lag):
            out[lag] += signal[i] * signal[i + lag]
    return out


@kernel_for("Tuple((float64, float64[::1]))(float64[:, ::1], float64[::1])")
def weighted_mean(points: Array, weights: Array) -> tuple[float, Array]:
    """Return the sum of ``weights`` (shape ``(h,)``) and the weighted mean of the rows of
    ``points`` (shape ``(h, m)``).
    """
    count, m = points.shape
    total = 0.0
    mean = np.zeros(m)
    for h in range(count):
        total += weights[h]
        for i in range(m):
            mean[i] += weights[h] * points[h, i]
    for i in range(m):
        mean[i] /= total
    return total, mean


@kernel_for("float64[:, ::1](float64[:, ::1], float64[::1], float64[::1])")
def weighted_spread(points: Array, weights: Array, mean: Array) -> Array:
    """Return the weighted covariance of the rows of ``points`` (shape ``(h, m)``) around ``mean``
    (shape ``(m,)``).
    """
    count, m = points.shape
    total = 0.0
    for h in range(count):
        total += weights[h]
    spread = np.zeros((m, m))
    for h in range(count):
        for i in range(m):
            for j in range(m):
                apart = (points[h, i] - mean[i]) * (points[h, j] - mean[j])
                spread[i, j] += weights[h] / total * apart
    return spread


@kernel_for("float64(float64[::1], float64)")
def coloured_power(lags: Array, colour: float) -> float:
    """Return the variance that noise with an autocorrelation of ``colour**k`` makes behind a
    filter with the autocovariance ``lags``.
    """
    total = 0.0
    for k in range(lags.size - 1, 0, -1):
        total = colour * (lags[k] + total)
    return float(lags[0] + 2.0 * total)
