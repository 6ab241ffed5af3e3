"""A load of one shape at a steady period: up and down along straight lines, or on and off."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from compiled import kernel
from estimator.arrays import Array
from estimator.lanes import respond_one
from estimator.processes.poles import Poles

__all__ = ["PeriodicLoad", "cycle_of", "periodic_response"]

_SIZES = 3.0
"""What such a load pays: a size, a begin and a rise at half a ``log(n)`` each, and a period at one
and a half, because its standard error falls with ``n^(3/2)``; in ``log(n)``."""
_OWN_LAG = 0.5
"""The same for a lag of its own."""


@kernel
def periodic_response(
    wave: tuple[float, float, float],
    process: tuple[float, float, float, float],
    n: int,
    square: bool,
    before: int,
) -> Array:
    """Response ``(n,)`` of a process to a triangular or rectangular wave between -1 and 1.

    Args:
        wave: its cycles in the window, the share of a cycle at which it begins, and the share of a
            cycle during which it rises or, where it is rectangular, is high, between 0 and 1.
        process: coefficients; see `Poles.coefficients`.
        n: samples.
        square: whether it is rectangular; its edges may lie between samples.
        before: samples that it has worked for when the window begins; at rest before them.
    """
    cycles, begin, rise = wave
    load = np.empty(before + n)
    sample = cycles / n
    for k in range(before + n):
        x = cycles * (k - before) / n + begin
        x -= math.floor(x)
        if square:
            # its mean since the sample before, so that a small move of an edge changes it
            high = min(x, rise) - min(max(x - sample, 0.0), rise)
            load[k] = 2.0 * high / sample - 1.0
        else:
            load[k] = 2.0 * x / rise - 1.0 if x < rise else 1.0 - 2.0 * (x - rise) / (1.0 - rise)
    return respond_one(load, *process)[before:]


@dataclass(frozen=True, slots=True)
class PeriodicLoad:
    """A load of that shape of unknown size, at the valve or through a lag of its own.

    Its many harmonics hang together. Paid for one by one they never pay, and the load is taken for
    a sticky valve.

    Attributes:
        cycles, begin, rise: the wave; see `periodic_response`.
        through: the process that it goes through, as known when the load was found, or its own lag,
            which may be none.
        square: whether it is rectangular, as from a neighbour that is switched on and off, or else
            triangular.
        own: whether ``through`` is a lag of its own.
    """

    cycles: float
    begin: float
    rise: float
    through: Poles
    square: bool = False
    own: bool = False

    def columns(self, stem: Array, poles: Poles, dead_time: int) -> Array:
        """The response to it, ``(1, n)``."""
        del poles, dead_time
        wave = self.cycles, self.begin, self.rise
        n = stem.size
        before = cycle_of(self.cycles, n) if self.own else 0
        found: Array = periodic_response(wave, self.through.coefficients, n, self.square, before)
        return found[None]

    def price(self, rows: float) -> float:
        """A size, where it is, and its own lag; not its process where that is the valve's."""
        return (_SIZES + (_OWN_LAG if self.own else 0.0)) * math.log(rows)


def cycle_of(cycles: float, n: int) -> int:
    """Samples of one cycle, of so many in a window of ``n``."""
    return math.ceil(n / cycles)
