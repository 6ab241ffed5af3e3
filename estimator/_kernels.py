"""Compiled inner loops: many valve candidates at once, one in each SIMD lane.

Signals of candidates are arrays of shape ``(samples, candidates)``: the outer loop runs over
samples, the inner one over candidates, so that the compiler turns each line into vector
instructions and every branch into a select. What least squares needs of these signals is then one
matrix product (BLAS), which is why nothing else has to be compiled.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["Array", "Mask", "fir", "lag", "stems"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_kernel = partial(njit, cache=True, fastmath=True, error_model="numpy")


@_kernel("void(f8[::1], f8[::1], f8[::1], f8[::1], f8[:, ::1], f8[::1])")
def _stems(
    op: Array, static: Array, dynamic: Array, start: Array, out: Array, moves: Array
) -> None:
    x = start.copy()
    for k in range(op.size):
        u = op[k]
        row = out[k]
        for j in range(x.size):
            e = u - x[j]
            moved = u - dynamic[j] if e > static[j] else x[j]
            moved = u + dynamic[j] if e < -static[j] else moved
            moves[j] += 1.0 if moved != x[j] else 0.0
            x[j] = moved
            row[j] = moved


@_kernel("void(f8[:, ::1], f8, f8, f8[:, ::1])")
def _lag(signal: Array, pole: float, gain: float, out: Array) -> None:
    n, m = signal.shape
    for j in range(m):
        # a lag begins at rest, an integrator (pole 1) at zero
        out[0, j] = signal[0, j] * (1.0 if pole < 1.0 else gain)
    for k in range(1, n):
        now = out[k]
        before = out[k - 1]
        x = signal[k]
        for j in range(m):
            now[j] = pole * before[j] + gain * x[j]


@_kernel("void(f8[:, ::1], f8[::1], f8[:, ::1])")
def _fir(signal: Array, taps: Array, out: Array) -> None:
    n, m = signal.shape
    for k in range(n):
        now = out[k]
        for j in range(m):
            now[j] = taps[0] * signal[k, j]
        for i in range(1, taps.size):
            past = signal[max(k - i, 0)]
            for j in range(m):
                now[j] += taps[i] * past[j]


def stems(op: Array, stick_band: Array, slip_jump: Array, start: Array) -> tuple[Array, Array]:
    """Stem positions of He's valve, equation (4), for many candidates, and how often each moves.

    ``op`` has shape ``(n,)``; ``stick_band``, ``slip_jump`` and ``start`` (the position before the
    first sample) have shape ``(m,)``. Returns the positions ``(n, m)`` and the moves ``(m,)``.
    """
    static = np.ascontiguousarray(0.5 * (stick_band + slip_jump))
    dynamic = np.ascontiguousarray(0.5 * (stick_band - slip_jump))
    out, moves = np.empty((op.size, static.size)), np.zeros(static.size)
    _stems(op, static, dynamic, np.ascontiguousarray(start), out, moves)
    return out, moves


def lag(signal: Array, pole: float) -> Array:
    """First-order lag of unit gain, started at rest; ``pole = 1`` is an integrator started at zero.

    ``signal`` has shape ``(n, m)``; so has the result. The integrator's gain is ``1 / n`` so that
    its output is of the order of its input.
    """
    out = np.empty_like(signal)
    _lag(signal, pole, 1.0 - pole if pole < 1.0 else 1.0 / signal.shape[0], out)
    return out


def fir(signal: Array, taps: Array) -> Array:
    """Moving average ``taps[0] s_k + taps[1] s_(k-1) + ...``, the first sample held before."""
    out = np.empty_like(signal)
    _fir(signal, taps, out)
    return out
