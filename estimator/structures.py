"""Low-order processes for the simulation criterion: two poles, a gain, a dead time.

A structure is the pair of poles of two lags in series. A pole at 0 is no lag, a pole at 1 is an
integrator, so that ``(0, 0)`` is a pure gain, ``(p, 0)`` a lag, ``(p, q)`` two lags, ``(1, 0)`` an
integrating process and ``(1, p)`` one with a lag. Everything else is linear.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from estimator._kernels import Array, lag

__all__ = ["COARSE", "Structure", "shared_columns"]


@dataclass(frozen=True, slots=True, order=True)
class Structure:
    """Poles of the two lags, ``0 <= fast <= slow <= 1``."""

    slow: float
    fast: float

    @classmethod
    def of_time_constants(cls, slow: float, fast: float = 0.0) -> Structure:
        """Build from time constants in samples; 0 is no lag, infinity an integrator."""
        slow, fast = max(slow, fast), min(slow, fast)
        return cls(_pole(slow), _pole(fast))

    @property
    def name(self) -> str:
        """The structure in words."""
        if self.slow == 0.0:
            return "gain"
        if self.slow == 1.0:
            return "integrating" if self.fast == 0.0 else "integrating with lag"
        return "lag" if self.fast == 0.0 else "two lags"

    @property
    def poles(self) -> tuple[float, ...]:
        """The poles that are not zero."""
        return tuple(p for p in (self.slow, self.fast) if p > 0.0)

    @property
    def integrating(self) -> bool:
        """Whether the process integrates."""
        return self.slow == 1.0

    @property
    def free(self) -> int:
        """Parameters besides the valve: gain, offset, dead time, time constants."""
        return 3 + sum(0.0 < p < 1.0 for p in (self.slow, self.fast)) + int(self.integrating)

    def response(self, signal: Array) -> Array:
        """Unit-gain response to ``signal``, shape ``(n,)``."""
        for pole in self.poles:
            signal = lag(signal, pole)
        return signal

    def columns(self, n: int) -> Array:
        """Signals of unknown size besides the response, shape ``(k, n)``.

        The offset; a slow drift, one half-wave of a cosine per ``_DRIFT_SAMPLES``; what is left of
        the unknown state before the window (it decays with the slow pole); for an integrating
        process the unknown equilibrium, which is a straight line in PV.
        """
        columns = shared_columns(n, integrating=self.integrating)
        pole = self.fast if self.integrating else self.slow
        if pole > 0.3:
            columns = np.vstack([columns, pole ** np.arange(n)])
        return columns


@lru_cache(maxsize=8)
def shared_columns(n: int, *, integrating: bool) -> Array:
    """Offset, drift and, for an integrating process, the straight line; shape ``(k, n)``.

    Not to be written to: windows of one length share them.
    """
    k = np.arange(n)
    waves = range(1, (n - 1) // _DRIFT_SAMPLES + 1)
    columns: list[Array] = [np.ones(n)]
    if integrating:
        columns.append(k / n - 0.5)
    columns += [np.cos(np.pi * wave * (k + 0.5) / n) for wave in waves]
    stacked = np.stack(columns)
    stacked.flags.writeable = False
    return stacked


def _pole(time_constant: float) -> float:
    if time_constant <= 0.0:
        return 0.0
    return math.exp(-1.0 / time_constant)


_DRIFT_SAMPLES = 1000

COARSE = (
    Structure(0.0, 0.0),
    *(Structure.of_time_constants(t) for t in (0.7, 1.5, 3.0, 6.0, 12.0, 25.0, 50.0, 100.0)),
    *(Structure.of_time_constants(t, t) for t in (1.5, 4.0, 10.0, 25.0)),
    Structure(1.0, 0.0),
    Structure.of_time_constants(math.inf, 4.0),
    Structure.of_time_constants(math.inf, 16.0),
)
"""Structures of the coarse pass; refinement moves their time constants."""
