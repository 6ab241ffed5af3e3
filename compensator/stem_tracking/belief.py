"""One hypothesis on the stem and what it believes to be wrong in the parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ERRORS", "FRICTION", "GAIN", "LOAD", "Belief"]

LOAD, FRICTION, GAIN = 0, 1, 2
ERRORS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """One hypothesis, as it was at one scan.

    Attributes:
        stem: position by the model's equations; direction: of its last slip (0: unknown).
        state: of the process at this scan, shape ``(n,)``.
        errors: ``(m, w, g)``: load, error of fD, relative error of the gain (`StemTracker`).
        noise: equation noise seen in this scan's PV, on its way into the next state.
        survived: largest command withstood, in deviations of the static friction around fS (minus
            infinity: none near it); a slip lets it fade, because friction varies.
        way: of this scan's slip.
    """

    stem: float
    direction: float
    state: NDArray[np.float64]
    errors: NDArray[np.float64]
    noise: float
    survived: float
    way: float
