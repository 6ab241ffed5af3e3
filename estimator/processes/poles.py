"""A process as its poles: two lags, a swinging pair, or an integrator; each with one lag more.

Poles are continuous: a grid of processes is where a search begins, never where it ends. (A gridded
process leaves an error that a sticky valve can explain: it invents stiction.) The gain and the dead
time are linear or counted in samples and stand elsewhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from compiled import kernel
from estimator.arrays import Array
from estimator.lanes import respond_one

__all__ = [
    "COARSE",
    "INTEGRATOR",
    "SHAPE_NUMBERS",
    "STARTS",
    "Poles",
    "Shape",
    "coefficients",
    "coefficients_of",
    "coefficients_of_one",
    "moved_poles",
    "pole_prices",
]

_NO_LAG = 0.12
"""Time constant (samples) below which a lag is none: its pole is below 0.0003."""
_SLOWEST = 2000.0
"""Longest time constant (samples): slower processes are integrating ones."""
_FASTEST_SWING = 3.0
"""Shortest period (samples) of a swing that samples show."""
_LEAST_DAMPING, _MOST_DAMPING = 0.02, 0.98
INTEGRATOR = 0.05
"""Gain of an integrator: its responses are then of the size of those of other processes."""


class Shape(StrEnum):
    """What the two main poles are."""

    LAGS = "lags"
    SWINGING = "swinging"
    INTEGRATING = "integrating"


@dataclass(frozen=True, slots=True)
class Poles:
    """Poles of a sampled process of unit gain.

    Attributes:
        shape: which of the meanings below holds.
        slow: longer time constant in samples (lags), period of the undamped swing in samples
            (swinging), unused (integrating).
        fast: shorter time constant in samples (lags, integrating; 0 is none), damping ratio
            between 0 and 1 (swinging).
        third: time constant in samples of one lag more; 0 is none.
    """

    shape: Shape
    slow: float
    fast: float = 0.0
    third: float = 0.0

    @property
    def integrating(self) -> bool:
        """Whether the process integrates."""
        return self.shape is Shape.INTEGRATING

    @property
    def count(self) -> int:
        """Poles that are parameters."""
        third = int(self.third > 0.0)
        if self.shape is Shape.SWINGING:
            return 2 + third
        if self.shape is Shape.INTEGRATING:
            return 1 + int(self.fast > 0.0) + third
        return int(self.slow > 0.0) + int(self.fast > 0.0) + third

    @property
    def coefficients(self) -> tuple[float, float, float, float]:
        """``c1, c2`` of the two main poles, the third pole, and the gain that makes B(1)/A(1) 1."""
        found: tuple[float, float, float, float] = coefficients_of_one(
            SHAPE_NUMBERS[self.shape], self.slow, self.fast, self.third
        )
        return found

    @property
    def denominator(self) -> tuple[float, ...]:
        """``(a1, a2, ...)`` of the ARX form, the leading 1 left out."""
        c1, c2, third, _ = self.coefficients
        a = [-c1, -c2]
        if third > 0.0:
            a = [-c1 - third, -c2 + c1 * third, c2 * third]
        while a and a[-1] == 0.0:
            a.pop()
        return tuple(a)

    @property
    def numerator(self) -> float:
        """``b1`` of the ARX form at unit gain."""
        _, _, third, gain = self.coefficients
        return gain * (1.0 - third)

    def moved(self, steps: Array) -> Array:
        """Many processes of this shape, ``(m, 3)``: each number times ``exp`` of its step.

        ``steps`` is ``(m, 3)``. A lag shorter than what the samples can show becomes none.
        """
        start = np.array([self.slow, self.fast, self.third])
        found: Array = moved_poles(SHAPE_NUMBERS[self.shape], start, steps)
        return found

    def of_row(self, row: Array) -> Poles:
        """The process of one row of such a table."""
        return Poles(self.shape, float(row[0]), float(row[1]), float(row[2]))

    def response(self, stem: Array) -> Array:
        """Unit-gain response ``(n,)`` to a stem ``(n,)``, at rest before the first sample."""
        c1, c2, third, gain = self.coefficients
        out: Array = respond_one(stem, c1, c2, third, gain)
        return out


SHAPE_NUMBERS = {Shape.LAGS: 0, Shape.SWINGING: 1, Shape.INTEGRATING: 2}
"""The shapes as the kernels know them."""


@kernel
def moved_poles(shape: int, start: Array, steps: Array) -> Array:
    """Processes ``(m, 3)``; see `Poles.moved`."""
    out = np.empty((steps.shape[0], 3))
    for j in range(steps.shape[0]):
        for i in range(3):
            value = min(start[i] * math.exp(steps[j, i]), _SLOWEST)
            out[j, i] = 0.0 if value < _NO_LAG else value
        if shape == 1:
            out[j, 0] = max(out[j, 0], _FASTEST_SWING)
            damping = start[1] * math.exp(steps[j, 1])
            out[j, 1] = min(max(damping, _LEAST_DAMPING), _MOST_DAMPING)
    return out


@kernel
def coefficients_of_one(
    shape: int, slow: float, fast: float, third: float
) -> tuple[float, float, float, float]:
    """Coefficients of one process; see `Poles.coefficients`."""
    last = math.exp(-1.0 / third) if third > 0.0 else 0.0
    if shape == 1:
        angle = 2.0 * math.pi / slow
        size = math.exp(-fast * angle)
        c1 = 2.0 * size * math.cos(angle * math.sqrt(max(0.0, 1.0 - fast * fast)))
        c2 = -size * size
        return c1, c2, last, 1.0 - c1 - c2
    q = math.exp(-1.0 / fast) if fast > 0.0 else 0.0
    if shape == 2:
        return 1.0 + q, -q, last, INTEGRATOR * (1.0 - q)
    p = math.exp(-1.0 / slow) if slow > 0.0 else 0.0
    return p + q, -p * q, last, (1.0 - p) * (1.0 - q)


@kernel
def coefficients_of(shape: int, table: Array) -> Array:
    """``c1``, ``c2``, third pole and gain as rows ``(4, m)``; see `Poles.coefficients`."""
    found = np.empty((4, table.shape[0]))
    for j in range(table.shape[0]):
        found[0, j], found[1, j], found[2, j], found[3, j] = coefficients_of_one(
            shape, table[j, 0], table[j, 1], table[j, 2]
        )
    return found


@kernel
def pole_prices(shape: int, table: Array, rows: float) -> Array:
    """What the poles of processes ``(m, 3)`` cost on so many judged rows, in nats, ``(m,)``."""
    # an integrator's pole is fixed; its straight line is a parameter
    extra = 2 if shape == 2 else 0
    found = np.empty(table.shape[0])
    for j in range(table.shape[0]):
        lags = extra
        for i in range(3):
            lags += 1 if table[j, i] > 0.0 else 0
        found[j] = 0.5 * math.log(rows) * lags
    return found


def coefficients(shape: Shape, table: Array) -> Array:
    """Coefficients ``(4, m)`` of processes ``(m, 3)`` of one shape."""
    found: Array = coefficients_of(SHAPE_NUMBERS[shape], table)
    return found


def _lags(slow: float, fast: float = 0.0) -> Poles:
    return Poles(Shape.LAGS, slow, fast)


def _integrating(fast: float = 0.0) -> Poles:
    return Poles(Shape.INTEGRATING, 0.0, fast)


COARSE = (
    *(_lags(t) for t in (0.0, 1.0, 3.0, 8.0, 20.0, 60.0)),
    _integrating(),
)
"""Processes that every valve of the coarse search is tried with."""

STARTS = (
    *COARSE,
    *(_lags(t) for t in (0.6, 1.6, 2.2, 4.5, 6.0, 12.0, 35.0, 120.0, 300.0)),
    *(_lags(t, f * t) for t in (1.5, 3.0, 6.0, 12.0, 24.0, 50.0) for f in (0.3, 1.0)),
    *(Poles(Shape.SWINGING, t, z) for t in (8, 14, 24, 40, 70, 120) for z in (0.2, 0.4, 0.7)),
    *(_integrating(t) for t in (2.0, 5.0, 12.0)),
)
"""Processes from which the poles for one stem are refined."""
