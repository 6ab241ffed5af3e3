"""A load that swings to and fro, no two swings alike: its turns lie at times and heights of chance.

A triangular load whose period wanders, a saw-tooth, the swing of a neighbouring loop. Between two
turns it rises along a line or a bent one, all rises alike and all falls alike. Each turn has a time
and a height of its own, but they are no free numbers: the lengths of the rises are drawn from one
normal distribution, those of the falls from another, the tops and the bottoms from two more (a
model with random effects). What a turn costs is how far it narrows down what the distribution left
open, which is the less the steadier the wave is: a periodic load is the end of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from compiled import kernel
from estimator.arrays import Array
from estimator.lanes import respond_one
from estimator.processes.poles import Poles

__all__ = ["UnevenWave", "course_of", "slopes_of", "through_process"]

_SHORTEST = 1e-3
"""Samples from one turn to the next at least, where lengths are divided by."""


@dataclass(frozen=True, slots=True)
class UnevenWave:
    """Such a load, of unknown size as a whole.

    Attributes:
        times: of its turns in samples, ``m``, rising, the first before the window and the last
            behind it.
        heights: there, ``m``.
        bends: of the rises and of the falls, as sizes of the sines of one, two, ... half waves
            between two turns; empty where they are straight.
        through: the process that it goes through; None where it enters at PV.
        nats: what it pays; see `estimator.evidence.uneven_waves`.
    """

    times: tuple[float, ...]
    heights: tuple[float, ...]
    bends: tuple[tuple[float, ...], tuple[float, ...]]
    through: Poles | None
    nats: float

    def columns(self, stem: Array, poles: Poles, dead_time: int) -> Array:
        """The response to it, ``(1, n)``, its largest value one."""
        del poles, dead_time
        course = course_of(
            stem.size, np.array(self.times), np.array(self.heights), np.array(self.bends)
        )
        found: Array = course[None]
        if self.through is not None:
            found = through_process(found, self.through.coefficients)
        largest = float(np.abs(found).max())
        return found / largest if largest > 0.0 else found

    def price(self, rows: float) -> float:
        """What its turns and its shape cost, for the rows of the window that it was found in."""
        del rows
        return self.nats


@kernel
def course_of(n: int, times: Array, heights: Array, bends: Array) -> Array:
    """The load ``(n,)``; ``times``, ``heights`` ``(m,)``, ``bends`` ``(2, k)``."""
    out = np.empty(n)
    i, last = 0, times.size - 2
    for t in range(n):
        while i < last and times[i + 1] <= t:
            i += 1
        share = min(max((t - times[i]) / max(times[i + 1] - times[i], _SHORTEST), 0.0), 1.0)
        risen = share
        for k in range(bends.shape[1]):
            risen += bends[i % 2, k] * math.sin((k + 1) * math.pi * share)
        out[t] = heights[i] + (heights[i + 1] - heights[i]) * risen
    return out


@kernel
def slopes_of(times: Array, heights: Array, bends: Array, n: int) -> Array:
    """Change of the load with each time, height and bend, ``(2 m + 2 k, n)``.

    Bends in the order ``(0, 0), (1, 0), (0, 1), ...``.
    """
    m, count = times.size, bends.shape[1]
    out = np.zeros((2 * m + 2 * count, n))
    i, last = 0, m - 2
    for t in range(n):
        while i < last and times[i + 1] <= t:
            i += 1
        length = max(times[i + 1] - times[i], _SHORTEST)
        share = min(max((t - times[i]) / length, 0.0), 1.0)
        size = heights[i + 1] - heights[i]
        risen, slope = share, 1.0
        for k in range(count):
            angle = (k + 1) * math.pi
            risen += bends[i % 2, k] * math.sin(angle * share)
            slope += bends[i % 2, k] * angle * math.cos(angle * share)
            out[2 * m + 2 * k + i % 2, t] = size * math.sin(angle * share)
        out[i, t] = size * slope * (share - 1.0) / length
        out[i + 1, t] = -size * slope * share / length
        out[m + i, t] = 1.0 - risen
        out[m + i + 1, t] = risen
    return out


@kernel
def through_process(rows: Array, process: tuple[float, float, float, float]) -> Array:
    """Responses of a process to rows ``(m, n)``, at rest at the first value of each."""
    out = np.zeros(rows.shape)
    for r in range(rows.shape[0]):
        begin = 0
        # at rest until the row changes
        while begin + 1 < rows.shape[1] and rows[r, begin + 1] == rows[r, 0]:
            begin += 1
        out[r, begin:] = respond_one(rows[r, begin:], *process)
    return out
