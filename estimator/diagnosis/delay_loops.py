"""Compiled: how far loops that differ in dead time and gain alone amplify a disturbance."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from compiled import innermost, kernel
from estimator.algebra import is_stable
from estimator.arrays import Array, Index

__all__ = ["INSIDE", "sensitivities"]

Complex = NDArray[np.complex128]

INSIDE = 1.0 - 2.0**-53
"""Largest double below 1: a reflection coefficient up to it is that of a stable loop."""
_SIDE_BY_SIDE = 32
"""Frequencies that are looked at side by side: the least of them is the least in any order."""


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
    real, imaginary = np.empty(turns.size), np.empty(turns.size)
    found = np.empty(gains.shape)
    reached = 0
    for d in range(dead_times.size):
        while reached < dead_times[d]:
            for k in range(turns.size):
                answer[k] *= turns[k]
            reached += 1
        for k in range(turns.size):
            real[k], imaginary[k] = answer[k].real, answer[k].imag
        for g in range(gains.shape[1]):
            found[d, g] = _largest(real, imaginary, gains[d, g])
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
def _largest(real: Array, imaginary: Array, gain: float) -> float:
    """Largest ``1 / |1 + gain answer|`` of an answer given by its parts, ``(f,)`` each."""
    side = _SIDE_BY_SIDE
    squares = np.full(side, math.inf)
    k = 0
    while k + side <= real.size:
        _least_squares(real[k : k + side], imaginary[k : k + side], gain, squares)
        k += side
    _least_squares(real[k:], imaginary[k:], gain, squares[: real.size - k])
    least = squares.min()
    return 1.0 / math.sqrt(least) if least > 0.0 else math.inf


@innermost
def _least_squares(real: Array, imaginary: Array, gain: float, squares: Array) -> None:
    """The lesser of each square so far and ``|1 + gain answer|^2``."""
    for i in range(squares.size):
        along, across = 1.0 + gain * real[i], gain * imaginary[i]
        square = along * along + across * across
        squares[i] = square if square < squares[i] else squares[i]
