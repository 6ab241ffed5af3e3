"""A load of any course: steps and straight lines that begin at rows of the window."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from compiled import kernel
from estimator.arrays import Array
from estimator.lanes import respond_one
from estimator.processes.poles import Poles

__all__ = [
    "CORNER_PRICE",
    "NO_PROCESS",
    "Corner",
    "PiecewiseLoad",
    "course_of_corners",
    "load_response",
]

CORNER_PRICE = 1.5
"""What a corner pays, in ``log(n)``: one for its place, half of one for its size."""

NO_PROCESS = (0.0, 0.0, 0.0, 1.0)
"""Coefficients of a load that enters behind the process, where PV is measured."""


@dataclass(frozen=True, slots=True)
class Corner:
    """From a ``row`` on the load is a ``step`` higher, and rises by a ``slope`` a row more."""

    row: int
    slope: float
    step: float


@kernel
def load_response(load: Array, process: tuple[float, float, float, float]) -> Array:
    """Response ``(n,)`` of a process to a load that was zero before the window."""
    before = np.zeros(load.size + 1)
    before[1:] = load
    return respond_one(before, *process)[1:]


def course_of_corners(corners: tuple[Corner, ...], n: int) -> Array:
    """The load ``(n,)`` that has these corners."""
    load = np.zeros(n)
    for corner in corners:
        load[corner.row :] += corner.step + corner.slope * np.arange(1.0, n - corner.row + 1.0)
    return load


@dataclass(frozen=True, slots=True)
class PiecewiseLoad:
    """A load made of corners, of unknown size as a whole.

    Steps of a load, ramps, a wave whose period and height change from cycle to cycle: what no
    periodic wave explains, and what a sticky valve can look like from OP and PV. Its corners are
    found, and their sizes among each other, for one process and noise model.

    Attributes:
        corners: where it changes.
        through: the process that it goes through; None where it enters at PV.
    """

    corners: tuple[Corner, ...]
    through: Poles | None

    def columns(self, stem: Array, poles: Poles, dead_time: int) -> Array:
        """The response to it, ``(1, n)``, its largest value one."""
        del poles, dead_time
        load = course_of_corners(self.corners, stem.size)
        process = NO_PROCESS if self.through is None else self.through.coefficients
        found: Array = load_response(load, process)
        largest = float(np.abs(found).max())
        return found[None] / largest if largest > 0.0 else found[None]

    def price(self, rows: float) -> float:
        """A place and a size for every corner."""
        return CORNER_PRICE * len(self.corners) * math.log(rows)
