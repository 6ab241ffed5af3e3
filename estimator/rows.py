"""The rows that every hypothesis of a window is judged on: chosen once, owned by the window."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from compiled import kernel
from estimator.arrays import Array, Index
from estimator.settings import Modelling
from estimator.window import Window

__all__ = ["JudgedRows", "Rows", "judged_rows", "rows_of", "step_of_levels"]

JudgedRows = tuple[Index, Index, Index]
"""Judged rows, and the first and last of each run; see `judged_rows`."""


@dataclass(frozen=True)
class Rows:
    """A scaled window and its one row mask.

    Attributes:
        u: OP, ``(n,)``, spanning one.
        y: PV, ``(n,)``, of unit variance; bad samples bridged by straight lines.
        spread: sum of squares of OP around its mean.
        weight: 1 for a row that is judged, else 0; the first ``first`` rows are past only.
        first: rows that no hypothesis is judged on.
        count: rows that are judged.
        floor: squared residual that PV's resolution leaves at least.
        sign: sign that the process gain must have by the controller's action, 0 where unclear.
        shared: columns that every hypothesis has, ``(m, n)``: offset, start-up.
        sloping: the same and the straight line of an unknown equilibrium, ``(m + 1, n)``, for
            integrating processes.
        informed: share of the samples that were measured and not drawn by a historian.
        soonest: least dead time that a process may have, in samples.
    """

    u: Array
    y: Array
    spread: float
    weight: Array
    first: int
    count: float
    floor: float
    sign: float
    shared: Array
    sloping: Array
    informed: float = 1.0
    soonest: int = 0

    @property
    def size(self) -> int:
        """Samples of the window."""
        return int(self.u.size)

    @cached_property
    def judged(self) -> JudgedRows:
        """The judged rows, and the first and last of each run."""
        found: JudgedRows = judged_rows(self.weight, self.first, 1)
        return found

    def columns(self, *, integrating: bool) -> Array:
        """Columns of unknown size beside the response, ``(m, n)``."""
        return self.sloping if integrating else self.shared


@kernel
def judged_rows(weight: Array, first: int, stride: int) -> JudgedRows:
    """Every ``stride``-th row from ``first`` on, those that are judged; first and last of each run.

    A run is rows of which each is ``stride`` after the one before.
    """
    rows, begins = np.empty(weight.size, dtype=np.int64), np.empty(weight.size, dtype=np.int64)
    ends = np.empty(weight.size, dtype=np.int64)
    count = runs = 0
    for k in range(first, weight.size, stride):
        if weight[k] != 0.0:
            if count == 0 or rows[count - 1] != k - stride:
                begins[runs] = k
                runs += 1
            ends[runs - 1] = k
            rows[count] = k
            count += 1
    return rows[:count], begins[:runs], ends[:runs]


def rows_of(
    window: Window, sign: float, settings: Modelling, informed: float = 1.0, soonest: int = 0
) -> Rows:
    """The rows of a window; ``sign`` is that of the process gain, 0 where it is not known.

    For ``informed`` and ``soonest`` see `Rows`.
    """
    n = window.size
    k = np.arange(n, dtype=np.float64)
    good = window.good
    y = np.interp(k, k[good], window.y[good])
    # a sample after a gap has no past to be predicted from
    usable = good.copy()
    for late in (1, 2):
        usable[late:] &= good[:-late]
    first = min(settings.memory, n // 4)
    usable[:first] = False
    decay = settings.startup / (1.0 + settings.startup)
    shared = np.stack([np.ones(n), decay**k])
    return Rows(
        u=window.u,
        y=y,
        # exact, so that every processor finds the same
        spread=math.fsum(np.square(window.u - math.fsum(window.u) / n)),
        weight=usable.astype(np.float64),
        first=first,
        count=float(usable.sum()),
        # about half the standard deviation of rounding PV to its levels
        floor=max(settings.floor, _ROUNDING * step_of_levels(window.y[good])) ** 2,
        sign=sign,
        shared=shared,
        sloping=np.vstack([shared, k / n]),
        informed=informed,
        soonest=soonest,
    )


_ROUNDING = 0.15
_LEVELS = 200


def step_of_levels(signal: Array) -> float:
    """Step between the levels that a signal was recorded in; 0 where it has too many to have any.

    ``signal`` is ``(n,)``.
    """
    levels = np.diff(np.unique(np.round(signal, 9)))
    return float(levels.min()) if 0 < levels.size < _LEVELS else 0.0
