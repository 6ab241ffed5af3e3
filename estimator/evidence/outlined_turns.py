"""Where an outlined load turns: with what an uneven wave begins.

A load of steps and lines (`estimator.evidence.piecewise_loads`) has many more corners than turns. A
turn is where it goes back by a swing; a wave has many of them, at lengths that repeat themselves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from compiled import kernel
from estimator.algebra import dot
from estimator.arrays import Array, Index

__all__ = ["FEWEST_TURNS", "turning_rows", "turns_of"]

_SWINGS = (1.0, 2.0)
"""Standard deviations of the outline that it must swing by to turn: small corners are noise."""
FEWEST_TURNS, _MOST_TURNS = 7, 80
"""Turns of a wave: at least as many as its distributions have numbers (3.5 cycles); the
price holds what they do not tell. More than these, those beyond what was seen counted, are too
fast to be told from noise, and a fit's work grows with the square of their number."""
_REPEATED = 0.2
"""Deviation, over a cycle, of an outline's lengths at most: twice that of a wave's."""


def turns_of(outline: Array) -> Iterator[tuple[Array, Array]]:
    """Times and heights of the turns of a load ``(n,)``, with those beyond the window's ends."""
    n = outline.size
    about = outline - outline.mean()
    size = math.sqrt(dot(about, about) / n)
    seen = 0
    for swing in _SWINGS:
        rows = turning_rows(outline, swing * size)
        if rows.size < FEWEST_TURNS or rows.size == seen:
            continue
        seen = rows.size
        times, heights = rows.astype(np.float64), outline[rows]
        between = [np.diff(times)[j::2] for j in (0, 1)]
        cycle = sum(float(one.mean()) for one in between)
        if max(float(one.std()) for one in between) > _REPEATED * cycle:
            continue
        lengths = [float(np.median(one)) for one in between]
        levels = [float(np.median(heights[j::2])) for j in (0, 1)]
        before, after = [], []
        at, k = times[0], 0
        while at > 0.0:
            k += 1
            at -= max(1.0, lengths[k % 2])
            before.append((at, levels[k % 2]))
        at, k = times[-1], times.size - 1
        while at < n - 1.0:
            at += max(1.0, lengths[k % 2])
            k += 1
            after.append((at, levels[k % 2]))
        every = (*before[::-1], *zip(times, heights, strict=True), *after)
        if len(every) > _MOST_TURNS:
            continue
        yield np.array([t for t, _ in every]), np.array([h for _, h in every])


@kernel
def turning_rows(load: Array, swing: float) -> Index:
    """Rows at which a load turns and goes back by a ``swing`` at least."""
    rows = np.empty(load.size, np.int64)
    count = way = high = low = 0
    for k in range(1, load.size):
        if way >= 0 and load[k] > load[high]:
            high = k
        if way <= 0 and load[k] < load[low]:
            low = k
        if way >= 0 and load[high] - load[k] > swing:
            rows[count] = high
            count, way, low = count + 1, -1, k
        elif way <= 0 and load[k] - load[low] > swing:
            rows[count] = low
            count, way, high = count + 1, 1, k
    # the first is an end of the window
    begin = 1 if count > 0 and rows[0] <= 2 else 0
    return rows[begin:count].copy()
