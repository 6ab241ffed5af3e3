"""The true course of a loop, for judging results; no controller sees it."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["CycleRecord", "Truth", "TruthLog"]

CAPACITY = 200_000

Array = NDArray[np.float64]


class CycleRecord(NamedTuple):
    """One control cycle k: PV read, OP computed from it and applied, the stem it led to.

    Attributes:
        op, pv, sp: as published, NaN where unknown.
        stem: stem position while ``op`` was applied; NaN where unknown.
        automatic: whether a controller computed ``op``.
        compensated: whether the compensator did.
        status: of a controller outside, for its register; None without one.
    """

    op: float
    pv: float
    sp: float
    stem: float
    automatic: bool
    compensated: bool
    status: int | None = None

    def with_stem(self, stem: float) -> CycleRecord:
        """Return the record with the stem that the step led to."""
        return CycleRecord(
            self.op, self.pv, self.sp, stem, self.automatic, self.compensated, self.status
        )


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
    """Keeps the last ``capacity`` cycles of a loop, in 34 bytes each."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._capacity = capacity
        self._cycles = 0
        self._signals = tuple(array("d") for _ in range(4))
        self._flags = tuple(array("b") for _ in range(2))

    def add(self, record: CycleRecord) -> None:
        """Take in the next cycle."""
        op, pv, sp, stem = self._signals
        op.append(record.op)
        pv.append(record.pv)
        sp.append(record.sp)
        stem.append(record.stem)
        automatic, compensated = self._flags
        automatic.append(record.automatic)
        compensated.append(record.compensated)
        self._cycles += 1
        # Now and then, because what is deleted at the front moves all the rest.
        if len(op) > self._capacity + self._capacity // 4:
            for signal in self._signals:
                del signal[: -self._capacity]
            for flags in self._flags:
                del flags[: -self._capacity]

    def amend_stem(self, stem: float) -> None:
        """Set the stem of the last cycle, which became known after it."""
        self._signals[3][-1] = stem

    def arrays(self, last: int | None = None) -> Truth:
        """Return what is kept, or the ``last`` cycles of it, as copies."""
        kept = min(self._cycles, self._capacity if last is None else last)
        rows = slice(-kept, None) if kept else slice(0)
        op, pv, sp, stem = (np.array(column[rows]) for column in self._signals)
        automatic, compensated = (np.array(column[rows], bool) for column in self._flags)
        first = self._cycles - kept
        return Truth(np.arange(first, self._cycles), op, pv, sp, stem, automatic, compensated)
