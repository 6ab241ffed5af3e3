"""Energies of many stems' responses through one process, under several noise models at once."""

from __future__ import annotations

import numpy as np

from compiled import innermost, kernel
from estimator.arrays import Array, Index
from estimator.lane_costs import AT_ONCE, add_earlier, shift_earlier
from estimator.rows import judged_rows

__all__ = ["energies_of_stems"]

_FEW_RUNS = 8
"""Runs of judged rows up to which a shifted sum is cheaper than a sum of its own."""
_TILE = 64
"""Rows that go through process, noise models and sums at a time: they stay in the fastest cache."""


@innermost
def _respond(
    now: Array,
    before: Array,
    earlier: Array,
    x: Array,
    rest: Array,
    c1: float,
    c2: float,
    gain: float,
) -> None:
    """One row of responses of all lanes through one process."""
    for j in range(now.size):
        now[j] = c1 * before[j] + c2 * earlier[j] + gain * (x[j] - rest[j])


@kernel
def energies_of_stems(
    stems: Array,
    process: Array,
    noises: tuple[Array, Index],
    weight: Array,
    first: int,
    delays: Index,
) -> Array:
    """Sums of squares of whitened responses at each of the rising ``delays``, ``(N, D, L)``.

    Of stems ``(n, L)`` through one process of two poles, ``(4,)`` without a lag, and then through
    each of the noise models: taps ``(N, p)``, of which so many count as the orders ``(N,)`` say.
    """
    n, lanes = stems.shape
    taps, orders = noises
    judged = judged_rows(weight, first, 1)
    rows, few = judged[0], judged[1].size <= _FEW_RUNS
    longest = delays[-1]
    # behind two rows of rest
    responses = np.zeros((n + 2, lanes))
    white = np.empty((orders.size, n, lanes))
    out = np.zeros((orders.size, delays.size, lanes))
    every = np.zeros((orders.size, longest - delays[0] + 1, lanes))
    done = 0
    for begin in range(0, n, _TILE):
        end = min(n, begin + _TILE)
        _respond_rows(stems, process, begin, end, responses)
        more = done
        while more < rows.size and rows[more] < end:
            more += 1
        if end < n:
            more -= (more - done) % AT_ONCE
        for i in range(orders.size):
            _whiten_rows(responses[2:], taps[i, : orders[i]], begin, end, white[i])
            run = white[i].reshape(n * lanes)
            if few:
                add_earlier(run, lanes, longest, 0, rows[done:more], every[i, 0])
            else:
                for d in range(delays.size):
                    add_earlier(run, lanes, delays[d], 0, rows[done:more], out[i, d])
        done = more
    if few:
        for i in range(orders.size):
            shift_earlier(white[i].reshape(n * lanes), longest, 0, judged, 1, every[i])
            for d in range(delays.size):
                out[i, d] = every[i, longest - delays[d]]
    return out


@kernel
def _respond_rows(stems: Array, process: Array, begin: int, end: int, out: Array) -> None:
    """Rows of what `lanes.respond` gives for one process without a lag; ``out`` ``(n + 2, L)``."""
    c1, c2, gain = process[0], process[1], process[3]
    rest = stems[0]
    for k in range(begin, end):
        _respond(out[k + 2], out[k + 1], out[k], stems[k], rest, c1, c2, gain)


@kernel
def _whiten_rows(signals: Array, taps: Array, begin: int, end: int, out: Array) -> None:
    """Rows of what `lanes.whiten_lanes` gives for signals ``(n, L)``.

    Twice on purpose: one kernel for a tile and for whole signals slows the local search.
    """
    n, lanes = signals.shape
    for k in range(begin, min(end, taps.size)):
        out[k] = signals[k]
    begin = max(begin, taps.size)
    if begin >= end:
        return
    before = signals.reshape(n * lanes)
    now = out.reshape(n * lanes)[begin * lanes : end * lanes]
    source = before[begin * lanes : end * lanes]
    if taps.size == 0:
        now[:] = source
    i = 0
    while i + AT_ONCE <= taps.size:
        t0, t1, t2, t3 = taps[i], taps[i + 1], taps[i + 2], taps[i + 3]
        t4, t5, t6, t7 = taps[i + 4], taps[i + 5], taps[i + 6], taps[i + 7]
        at = (begin - 1 - i) * lanes
        s0, s1, s2, s3 = (
            before[at:],
            before[at - lanes :],
            before[at - 2 * lanes :],
            before[at - 3 * lanes :],
        )
        s4, s5, s6, s7 = (
            before[at - 4 * lanes :],
            before[at - 5 * lanes :],
            before[at - 6 * lanes :],
            before[at - 7 * lanes :],
        )
        for j in range(now.size):
            left = source[j] - t0 * s0[j] - t1 * s1[j] - t2 * s2[j] - t3 * s3[j]
            now[j] = left - t4 * s4[j] - t5 * s5[j] - t6 * s6[j] - t7 * s7[j]
        source = now
        i += AT_ONCE
    while i < taps.size:
        tap, one = taps[i], before[(begin - 1 - i) * lanes :]
        for j in range(now.size):
            now[j] = source[j] - tap * one[j]
        source = now
        i += 1
