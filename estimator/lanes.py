"""Compiled loops that work on many candidates side by side, one a lane.

Signals of a batch have shape ``(n, L)``: samples down, candidates across. The innermost loop goes
over the lanes, which are independent of each other, so that the result of a candidate is the same
bits whatever the width of the processor's lanes and whichever other candidates stand beside it.
"""

from __future__ import annotations

import numpy as np

from compiled import kernel
from estimator.arrays import Array, Mask

__all__ = [
    "respond",
    "respond_one",
    "tells",
    "whiten_lanes",
]

_AT_ONCE = 4
"""Terms that one pass adds to a sum, one after the other: the same bits as one a pass, and a
quarter of the reading and writing."""
_LOOKED_AT = 100
"""Rows after which `tells` asks whether every stem works like a valve already."""


@kernel
def respond(stems: Array, c1: Array, c2: Array, third: Array, gain: Array) -> Array:
    """Responses ``(n, L)`` of two poles (``c1``, ``c2``), a lag (``third``) and a ``gain`` a lane.

    ``v_k = c1 v_(k-1) + c2 v_(k-2) + gain (x_k - x_0)``, then the lag; at rest before the window.
    """
    n, lanes = stems.shape
    out = np.empty((n, lanes))
    rest = stems[0]
    v1, v2, w = np.zeros(lanes), np.zeros(lanes), np.zeros(lanes)
    if not third.any():
        # the same numbers with less to read and to write
        for k in range(n):
            for j in range(lanes):
                v = c1[j] * v1[j] + c2[j] * v2[j] + gain[j] * (stems[k, j] - rest[j])
                v2[j] = v1[j]
                v1[j] = v
                out[k, j] = v
        return out
    for k in range(n):
        for j in range(lanes):
            v = c1[j] * v1[j] + c2[j] * v2[j] + gain[j] * (stems[k, j] - rest[j])
            v2[j] = v1[j]
            v1[j] = v
            w[j] = third[j] * w[j] + (1.0 - third[j]) * v
            out[k, j] = w[j]
    return out


@kernel
def respond_one(stem: Array, c1: float, c2: float, third: float, gain: float) -> Array:
    """The same for one stem ``(n,)``."""
    out = np.empty(stem.size)
    v1 = v2 = w = 0.0
    for k in range(stem.size):
        v = c1 * v1 + c2 * v2 + gain * (stem[k] - stem[0])
        v2 = v1
        v1 = v
        w = third * w + (1.0 - third) * v
        out[k] = w
    return out


@kernel
def whiten_lanes(signals: Array, taps: Array) -> Array:
    """Signals ``(n, L)`` through ``1 - taps_1 q^-1 - ...``; the first rows stay as they are."""
    n, lanes = signals.shape
    count = min(taps.size, n)
    out = signals.copy()
    # one run of numbers: a tap takes the number that stands so many rows before
    before = signals.reshape(n * lanes)
    now = out.reshape(n * lanes)[count * lanes :]
    i = 0
    while i + _AT_ONCE <= count:
        t0, t1, t2, t3 = taps[i], taps[i + 1], taps[i + 2], taps[i + 3]
        s0, s1 = before[(count - 1 - i) * lanes :], before[(count - 2 - i) * lanes :]
        s2, s3 = before[(count - 3 - i) * lanes :], before[(count - 4 - i) * lanes :]
        for j in range(now.size):
            now[j] = now[j] - t0 * s0[j] - t1 * s1[j] - t2 * s2[j] - t3 * s3[j]
        i += _AT_ONCE
    while i < count:
        tap, one = taps[i], before[(count - 1 - i) * lanes :]
        for j in range(now.size):
            now[j] -= tap * one[j]
        i += 1
    return out


@kernel
def tells(stems: Array, least_reversals: int, least_spread: float) -> Mask:
    """Which stems of ``(n, L)`` work like a valve, ``(L,)``.

    It turns often enough (what happens once is a step, which anything explains), and the sum of
    squares around its mean is at least ``least_spread``: (11b) of Bacci di Capaci et al., 2018.
    Both only grow from row to row: what works so far is looked at no further.
    """
    n, lanes = stems.shape
    direction, turns = np.zeros(lanes), np.zeros(lanes)
    total, squares = np.zeros(lanes), np.zeros(lanes)
    out = np.zeros(lanes, dtype=np.bool_)
    begin = 1
    while begin < n and not out.all():
        end = min(n, begin + _LOOKED_AT)
        for k in range(begin, end):
            now, before = stems[k], stems[k - 1]
            for j in range(lanes):
                # around the first value: a sum around the mean is this less what the mean is off
                x = now[j] - stems[0, j]
                step = now[j] - before[j]
                total[j] += x
                squares[j] += x * x
                way = 1.0 if step > 0.0 else (-1.0 if step < 0.0 else direction[j])
                turns[j] += 1.0 if way * direction[j] < 0.0 else 0.0
                direction[j] = way
        for j in range(lanes):
            spread = squares[j] - total[j] * total[j] / end
            out[j] = out[j] or (turns[j] >= least_reversals and spread >= least_spread)
        begin = end
    return out
