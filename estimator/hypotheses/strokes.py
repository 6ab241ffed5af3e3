"""Strokes of a stem: when each begins and ends, and the stem whose strokes are late and end off.

A rest ends a stroke here; `estimator.evidence.verdict.count_strokes` counts over rests.
"""

from __future__ import annotations

import math

import numpy as np

from compiled import kernel
from estimator.arrays import Array, Index

__all__ = ["MOVES", "changes_of", "strokes_of", "varied_stem"]

MOVES = 1e-9
"""Change of a stem, as a share of OP's span, below which it rests: rounding."""


@kernel
def strokes_of(stem: Array) -> tuple[Index, Index]:
    """First rows of the strokes of a stem ``(n,)``, and the rows behind their last ones."""
    begins, ends = np.empty(stem.size, np.int64), np.empty(stem.size, np.int64)
    count = way = 0
    for k in range(1, stem.size):
        step = stem[k] - stem[k - 1]
        now = 0 if abs(step) <= MOVES else (1 if step > 0.0 else -1)
        if way != 0 and now != way:
            ends[count - 1] = k
        if now not in (0, way):
            begins[count] = k
            count += 1
        way = now
    if way != 0:
        ends[count - 1] = stem.size
    return begins[:count], ends[:count]


@kernel
def varied_stem(stem: Array, begins: Index, ends: Index, strokes: Array) -> Array:
    """The stem ``(n,)`` whose strokes are late, and end off, by ``strokes`` ``(2 m,)``."""
    n, m = stem.size, begins.size
    moves = np.zeros(n + 1)
    off = 0.0
    for i in range(m):
        whole = math.floor(strokes[i])
        part = strokes[i] - whole
        for j in range(begins[i], ends[i]):
            step, row = stem[j] - stem[j - 1], j + whole
            moves[min(max(row, 0), n)] += (1.0 - part) * step
            moves[min(max(row + 1, 0), n)] += part * step
        moves[begins[i]] += strokes[m + i] - off
        off = strokes[m + i]
    out = np.empty(n)
    at = stem[0]
    for k in range(n):
        at += moves[k]
        out[k] = at
    return out


@kernel
def changes_of(stem: Array, begins: Index, ends: Index, strokes: Array) -> Array:
    """Change of that stem with each of the numbers, over a sample where a time, ``(2 m, n)``."""
    n, m = stem.size, begins.size
    out = np.zeros((2 * m, n))
    for i in range(m):
        for j in range(begins[i], ends[i]):
            step = stem[j] - stem[j - 1]
            first = max(math.floor(j + strokes[i]) - 1, 0)
            for k in range(first, min(first + 4, n)):
                at = k - j - strokes[i]
                later = min(max(at + 0.5, 0.0), 1.0)
                out[i, k] += step * (later - min(max(at + 1.5, 0.0), 1.0))
        rest = begins[i + 1] if i + 1 < m else n
        for k in range(begins[i], rest):
            out[m + i, k] = 1.0
    return out
