"""A triangular load: up and down along straight lines, at a steady period."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from compiled import kernel
from estimator.arrays import Array
from estimator.lanes import respond_one
from estimator.processes.poles import Poles

__all__ = ["TriangularLoad", "triangular_response"]

_SIZES = 3.0
"""What such a load pays: a size, a begin and a rise at half a ``log(n)`` each, and a period at one
and a half, because its standard error falls with ``n^(3/2)``; in ``log(n)``."""


@kernel
def triangular_response(
    wave: tuple[float, float, float], process: tuple[float, float, float, float], n: int
) -> Array:
    """Response ``(n,)`` of a process to a triangular wave between -1 and 1.

    Args:
        wave: its cycles in the window, the share of a cycle at which it begins, and the share of a
            cycle during which it rises, between 0 and 1.
        process: coefficients; see `Poles.coefficients`.
        n: samples.
    """
    cycles, begin, rise = wave
    load = np.empty(n)
    for k in range(n):
        x = cycles * k / n + begin
        x -= math.floor(x)
        load[k] = 2.0 * x / rise - 1.0 if x < rise else 1.0 - 2.0 * (x - rise) / (1.0 - rise)
    return respond_one(load, *process)


@dataclass(frozen=True, slots=True)
class TriangularLoad:
    """A load of that shape at the valve, of unknown size.

    Its many harmonics hang together. Paid for one by one they never pay, and the load is taken for
    a sticky valve.

    Attributes:
        cycles, begin, rise: the wave; see `triangular_response`.
        through: the process that it goes through, as known when the load was found.
    """

    cycles: float
    begin: float
    rise: float
    through: Poles

    def columns(self, stem: Array, poles: Poles, dead_time: int) -> Array:
        """The response to it, ``(1, n)``."""
        del poles, dead_time
        wave = self.cycles, self.begin, self.rise
        found: Array = triangular_response(wave, self.through.coefficients, stem.size)
        return found[None]

    def price(self, rows: float) -> float:
        """A size and where it is; not its process, which is that of the valve."""
        return _SIZES * math.log(rows)
