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
    "follow_covariance",
    "gram_of",
    "held_course",
    "lagged_products",
    "multiplied",
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


@kernel_for("float64[::1](float64[:, ::1], float64[::1], int64)")
def step_response_of(A: Array, B: Array, samples: int) -> Array:
    """Return the first state at 1, 2, ... ``samples`` samples after a unit step of the input.

    ``A`` is in observer form: beside its first column it moves each state to the one before.
    """
    n = B.size
    state = np.zeros(n)
    response = np.empty(samples)
    for k in range(samples):
        first = state[0]
        for i in range(n):
            now = A[i, 0] * first
            if i + 1 < n:
                now += state[i + 1]
            state[i] = now + B[i]
        response[k] = state[0]
    return response


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


@kernel_for(
    "void(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1], float64[:, ::1],"
    " float64[::1], float64, float64)",
)
def _carry_covariance(
    covariance: Array,
    out: Array,
    A: Array,
    gain: Array,
    q: Array,
    cross: Array,
    scale: float,
    noise: float,
) -> None:
    """Write ``F P F' + scale q + noise g g' - scale (c g' + g c')`` with ``F = A`` less the gain
    ``g`` in its first column: Joseph's form, right for any gain.
    """
    n = gain.size
    F = A.copy()
    for i in range(n):
        F[i, 0] -= gain[i]
    # Most of F is zero: each row has the first column, the next state, and what drives all states.
    used = np.empty((n, n), dtype=np.int64)
    count = np.zeros(n, dtype=np.int64)
    for i in range(n):
        for k in range(n):
            if F[i, k] != 0.0:
                used[i, count[i]] = k
                count[i] += 1
    half = np.zeros((n, n))
    for i in range(n):
        for c in range(count[i]):
            k = used[i, c]
            for j in range(n):
                half[i, j] += F[i, k] * covariance[k, j]
    for i in range(n):
        for j in range(i, n):
            value = noise * gain[i] * gain[j] + scale * (
                q[i, j] - cross[i] * gain[j] - cross[j] * gain[i]
            )
            for c in range(count[j]):
                value += half[i, used[j, c]] * F[j, used[j, c]]
            out[i, j] = out[j, i] = value


@kernel_for(
    "void(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1], float64, float64,"
    " float64[::1], float64[:, ::1], float64[::1], float64, float64, float64, float64,"
    " float64[:, ::1])"
)
def follow_covariance(
    covariance: Array,
    out: Array,
    transition: Array,
    B: Array,
    turn: float,
    way: float,
    gain: Array,
    q: Array,
    cross: Array,
    scale: float,
    noise: float,
    innovation: float,
    drift: float,
    renewed: Array,
) -> None:
    """Write the covariance of state and errors one scan on, after a slip of the stem by ``way``
    that changed its direction by ``turn`` (`SharedCovariance`), to ``out``; and the slip to
    ``transition``. The load drifts by the variance ``drift``, and what is forgotten of the errors
    of friction and gain comes back as ``renewed`` (shape ``(2, 2)``).
    """
    n = B.size
    load, friction, error = n, n + 1, n + 2
    for i in range(n):
        transition[i, friction] = B[i] * turn
        transition[i, error] = B[i] * way
    transition[load, friction], transition[load, error] = turn, way
    step = multiplied(transition, gain)
    if np.any(gain):
        for i in range(gain.size):
            step[i] += scale * cross[i] / innovation
    _carry_covariance(covariance, out, transition, step, q, cross, scale, noise)
    out[load, load] += drift
    for i in range(2):
        for j in range(2):
            out[friction + i, friction + j] += renewed[i, j]
