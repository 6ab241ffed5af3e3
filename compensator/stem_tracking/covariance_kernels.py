"""Compiled arithmetic of `SharedCovariance`; sums are taken as in `compensator.kernels`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from compensator.kernels import multiplied
from compensator.stem_tracking.belief import FRICTION, GAIN, LOAD
from compiled import kernel_for

__all__ = ["follow_covariance"]

Array = NDArray[np.float64]


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
    load, friction, error = n + LOAD, n + FRICTION, n + GAIN
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
