"""Compiled loops that work on many candidates side by side, one a lane.

Signals of a batch have shape ``(n, L)``: samples down, candidates across. The innermost loop goes
over the lanes, which are independent of each other, so that the result of a candidate is the same
bits whatever the width of the processor's lanes and whichever other candidates stand beside it.
"""

from __future__ import annotations

import numpy as np

from compiled import innermost, kernel
from estimator.arrays import Array, Mask

__all__ = [
    "respond",
    "respond_one",
    "respond_through",
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
    # behind two rows of rest
    rows = np.empty((n + 2, lanes))
    rows[:2] = 0.0
    rest = stems[0]
    for k in range(0, n - 1, 2):
        at, early, late = rows[k : k + 4], stems[k], stems[k + 1]
        _respond_two(at[2], at[3], at[1], at[0], early, late, rest, c1, c2, gain)
    if n % 2 == 1:
        k = n - 1
        _respond_row(rows[k + 2], rows[k + 1], rows[k], stems[k], rest, c1, c2, gain)
    if third.any():
        _lag(rows, third)
    return rows[2:]


@innermost
def _respond_row(
    now: Array,
    before: Array,
    earlier: Array,
    x: Array,
    rest: Array,
    c1: Array,
    c2: Array,
    gain: Array,
) -> None:
    """One row of responses to a row of stems."""
    for j in range(now.size):
        now[j] = c1[j] * before[j] + c2[j] * earlier[j] + gain[j] * (x[j] - rest[j])


@innermost
def _respond_two(
    now: Array,
    after: Array,
    before: Array,
    earlier: Array,
    x: Array,
    y: Array,
    rest: Array,
    c1: Array,
    c2: Array,
    gain: Array,
) -> None:
    """Two rows of responses: the second needs not wait until the first was written."""
    for j in range(now.size):
        v = c1[j] * before[j] + c2[j] * earlier[j] + gain[j] * (x[j] - rest[j])
        now[j] = v
        after[j] = c1[j] * v + c2[j] * before[j] + gain[j] * (y[j] - rest[j])


@innermost
def _respond_two_to_one(
    now: Array,
    after: Array,
    before: Array,
    earlier: Array,
    x: float,
    y: float,
    c1: Array,
    c2: Array,
    gain: Array,
) -> None:
    """The same where all lanes have one stem, ``x`` and ``y`` away from its rest."""
    for j in range(now.size):
        v = c1[j] * before[j] + c2[j] * earlier[j] + gain[j] * x
        now[j] = v
        after[j] = c1[j] * v + c2[j] * before[j] + gain[j] * y


@innermost
def _lag_row(now: Array, before: Array, third: Array) -> None:
    """One row through one lag more a lane."""
    for j in range(now.size):
        now[j] = third[j] * before[j] + (1.0 - third[j]) * now[j]


@kernel
def _lag(rows: Array, third: Array) -> None:
    """Put rows ``(2 + n, L)``, two of rest before them, through one lag more a lane, in place."""
    for k in range(2, rows.shape[0]):
        _lag_row(rows[k], rows[k - 1], third)


@kernel
def respond_through(stem: Array, processes: Array) -> Array:
    """Responses ``(n, L)`` of one stem ``(n,)`` through each of the processes ``(4, L)``.

    The numbers are those of `respond`.
    """
    n, lanes = stem.size, processes.shape[1]
    c1, c2, third, gain = processes[0], processes[1], processes[2], processes[3]
    rows = np.empty((n + 2, lanes))
    rows[:2] = 0.0
    for k in range(0, n - 1, 2):
        at, x, y = rows[k : k + 4], stem[k] - stem[0], stem[k + 1] - stem[0]
        _respond_two_to_one(at[2], at[3], at[1], at[0], x, y, c1, c2, gain)
    if n % 2 == 1:
        earlier, before, now = rows[n - 1], rows[n], rows[n + 1]
        x = stem[n - 1] - stem[0]
        for j in range(lanes):
            now[j] = c1[j] * before[j] + c2[j] * earlier[j] + gain[j] * x
    if third.any():
        _lag(rows, third)
    return rows[2:]


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
    out = np.empty((n, lanes))
    out[:count] = signals[:count]
    # one run of numbers: a tap takes the number that stands so many rows before
    before = signals.reshape(n * lanes)
    now = out.reshape(n * lanes)[count * lanes :]
    source = before[count * lanes :]
    # the first pass takes the signals as they are, the others what the one before has left
    if count == 0:
        now[:] = source
    elif count == 1:
        tap = taps[0]
        for j in range(now.size):
            now[j] = source[j] - tap * before[j]
    i = 0
    while i + 1 < count:
        # a tap of zero where there are less than four: it takes nothing away
        i2, i3 = min(i + 2, count - 1), min(i + 3, count - 1)
        t0, t1 = taps[i], taps[i + 1]
        t2, t3 = taps[i2] if i + 2 < count else 0.0, taps[i3] if i + 3 < count else 0.0
        s0, s1 = before[(count - 1 - i) * lanes :], before[(count - 2 - i) * lanes :]
        s2, s3 = before[(count - 1 - i2) * lanes :], before[(count - 1 - i3) * lanes :]
        if i == 0:
            for j in range(now.size):
                now[j] = source[j] - t0 * s0[j] - t1 * s1[j] - t2 * s2[j] - t3 * s3[j]
        else:
            for j in range(now.size):
                now[j] = now[j] - t0 * s0[j] - t1 * s1[j] - t2 * s2[j] - t3 * s3[j]
        i += _AT_ONCE
    while 0 < i < count:
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
            _tell(stems[k], stems[k - 1], stems[0], total, squares, direction, turns)
        for j in range(lanes):
            spread = squares[j] - total[j] * total[j] / end
            out[j] = out[j] or (turns[j] >= least_reversals and spread >= least_spread)
        begin = end
    return out


@innermost
def _tell(
    now: Array,
    before: Array,
    first: Array,
    total: Array,
    squares: Array,
    direction: Array,
    turns: Array,
) -> None:
    """Add a row of stems to what `tells` counts."""
    for j in range(now.size):
        # around the first value: a sum around the mean is this less what the mean is off
        x = now[j] - first[j]
        step = now[j] - before[j]
        total[j] += x
        squares[j] += x * x
        way = 1.0 if step > 0.0 else (-1.0 if step < 0.0 else direction[j])
        turns[j] += 1.0 if way * direction[j] < 0.0 else 0.0
        direction[j] = way
