"""Compiled: how far loops that differ in dead time and gain alone amplify a disturbance."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from compiled import kernel
from estimator.algebra import is_stable
from estimator.arrays import Array, Index

__all__ = ["INSIDE", "sensitivities"]

Complex = NDArray[np.complex128]

INSIDE = 1.0 - 2.0**-53
"""Largest double below 1: a reflection coefficient up to it is that of a stable loop."""


@kernel
def sensitivities(
    gains: Array, dead_times: Index, lag: tuple[float, float, float], r: Array, t: Array,
    turns: Complex,
) -> Array:  # fmt: skip
    """Largest amplification Ms of each loop; infinite where the loop is not stable.

    Args:
        gains: of the process, ``(d, g)``.
        dead_times: of each row, samples of at least 1, rising, ``(d,)``.
        lag: pole of the process, its first step's share of the gain, and a second pole or 0.
        r, t: the controller from error to OP as polynomials in ``q^-1``.
        turns: ``q^-1`` at the frequencies at which Ms is read, ``(f,)``.
    """
    pole, step, second = lag
    step *= 1.0 - second
    rest = np.convolve(t, np.convolve(np.array([1.0, -pole]), np.array([1.0, -second])))
    answer = np.empty(turns.size, dtype=np.complex128)
    for k in range(turns.size):
        answer[k] = step * _value(r, turns[k]) / _value(rest, turns[k])
    found = np.empty(gains.shape)
    reached = 0
    for d in range(dead_times.size):
        while reached < dead_times[d]:
            for k in range(turns.size):
                answer[k] *= turns[k]
            reached += 1
        for g in range(gains.shape[1]):
            found[d, g] = _largest(answer, gains[d, g])
            closed = np.zeros(max(rest.size, reached + r.size))
            closed[: rest.size] += rest
            closed[reached : reached + r.size] += gains[d, g] * step * r
            if not is_stable(-closed[1:] / closed[0], INSIDE):
                found[d, g] = math.inf
    return found


@kernel
def _value(polynomial: Array, q: complex) -> complex:
    value = 0.0 + 0.0j
    for k in range(polynomial.size - 1, -1, -1):
        value = value * q + polynomial[k]
    return value


@kernel
def _largest(answer: Complex, gain: float) -> float:
    """Largest ``1 / |1 + gain answer|``."""
    least = math.inf
    for k in range(answer.size):
        real, imaginary = 1.0 + gain * answer[k].real, gain * answer[k].imag
        least = min(least, real * real + imaginary * imaginary)
    return 1.0 / math.sqrt(least) if least > 0.0 else math.inf
