"""What really happened in a loop, for judging afterwards; nothing of it reaches a controller."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["CycleRecord", "Truth", "TruthLog"]

CAPACITY = 200_000

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CycleRecord:
    """One control cycle k: PV read, OP computed from it and applied, the stem it led to.

    Attributes:
        op, pv, sp: as published, NaN where unknown.
        stem: stem position while ``op`` was applied; NaN where nobody knows it.
        automatic: whether a controller computed ``op``.
        compensated: whether the compensator did.
    """

    op: float
    pv: float
    sp: float
    stem: float
    automatic: bool
    compensated: bool


@dataclass(frozen=True, eq=False)
class Truth:
    """The kept cycles of a loop as arrays of one length, oldest first.

    ``cycle`` holds the number of each, counted from 0 at the start of the PLC, also of those that
    are no longer kept; the other arrays are those of `CycleRecord`.
    """

    cycle: NDArray[np.int64]
    op: Array
    pv: Array
    sp: Array
    stem: Array
    automatic: NDArray[np.bool_]
    compensated: NDArray[np.bool_]


class TruthLog:
    """Keeps the last ``capacity`` cycles of a loop."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._records: deque[CycleRecord] = deque(maxlen=capacity)
        self._cycles = 0

    def add(self, record: CycleRecord) -> None:
        """Take in the next cycle."""
        self._records.append(record)
        self._cycles += 1

    def arrays(self) -> Truth:
        """Return what is kept."""
        records = list(self._records)
        columns: Iterable[tuple[float, ...]] = zip(*map(astuple, records), strict=True)
        op, pv, sp, stem, automatic, compensated = columns if records else ((),) * 6
        first = self._cycles - len(records)
        return Truth(
            np.arange(first, self._cycles),
            np.array(op, float),
            np.array(pv, float),
            np.array(sp, float),
            np.array(stem, float),
            np.array(automatic, bool),
            np.array(compensated, bool),
        )
