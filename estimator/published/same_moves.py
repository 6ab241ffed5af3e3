"""All valves that make the same moves, and the best among them.

After He's valve has moved up at sample ``j`` its stem is ``u_j - fD``: it goes on when OP has risen
by more than ``J`` and turns when OP has fallen by more than ``S``. So the valves that move at the
same samples of a window fill a rectangle in ``(S, J)``, and inside it the stem, and with it the
cost, depends on ``fD = (S - J) / 2`` alone, smoothly. A solver that follows derivatives sees
nothing beyond the rectangle; within it one bounded search over ``fD`` is all there is to do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from estimator.published.paper_fit import ArxWindow, PaperFit
from estimator.valves import HeValve

__all__ = ["MoveCell", "best_with_same_moves"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MoveCell:
    """The rectangle of valves with the same moves: ``low <= S < high``, likewise J; units of OP.

    What OP did before the first move is not counted: there the unknown first position decides.
    """

    stick_band: tuple[float, float]
    slip_jump: tuple[float, float]

    @classmethod
    def of(cls, op: Array, stem: Array, stem0: float) -> MoveCell:
        """The cell of a stem that He's valve made of ``op``, both of shape ``(n,)``."""
        before = np.concatenate([[stem0], stem[:-1]])
        moved = stem != before
        s_low, s_high, j_low, j_high = 0.0, math.inf, 0.0, math.inf
        samples = np.flatnonzero(moved)
        if samples.size == 0:
            return cls((s_low, s_high), (j_low, j_high))
        for at, after in zip(samples, [*samples[1:], op.size], strict=True):
            direction = 1.0 if op[at] > stem[at] else -1.0
            gone = direction * (op[at + 1 : after] - op[at])
            if gone.size:
                j_low = max(j_low, float(gone.max()))
                s_low = max(s_low, -float(gone.min()))
            if after < op.size:
                last = direction * float(op[after] - op[at])
                if last > 0.0:
                    j_high = min(j_high, last)
                else:
                    s_high = min(s_high, -last)
        return cls((s_low, s_high), (j_low, j_high))

    def dynamic_frictions(self) -> tuple[float, float]:
        """Least and greatest ``fD`` in the cell."""
        least = max(0.0, 0.5 * (self.stick_band[0] - self.slip_jump[1]))
        return least, 0.5 * (self.stick_band[1] - self.slip_jump[0])

    def valve(self, dynamic: float) -> HeValve | None:
        """The valve in the middle of the cell with this ``fD``; None when the cell has none."""
        low = max(self.slip_jump[0], self.stick_band[0] - 2.0 * dynamic)
        high = min(self.slip_jump[1], self.stick_band[1] - 2.0 * dynamic)
        if not low < high:
            return None
        slip_jump = 0.5 * (low + high) if math.isfinite(high) else low
        return HeValve(slip_jump + 2.0 * dynamic, slip_jump)


def best_with_same_moves(window: ArxWindow, fit: PaperFit) -> PaperFit:
    """The best of all valves that move when ``fit``'s valve does; ``fit`` itself if none is better.

    A valve without dynamic friction, or one that stands still, is left as it is: its moves have no
    direction that is known.
    """
    if fit.dynamic_friction == 0.0 or np.ptp(fit.stem) == 0.0:
        return fit
    cell = MoveCell.of(window.op, fit.stem, fit.stem0)
    low, high = cell.dynamic_frictions()
    # The cell is open towards large S when the valve never turned: the span of OP ends it.
    high = min(high, 0.5 * window.span)
    if not low < high:
        return fit

    def cost(dynamic: float) -> float:
        valve = cell.valve(dynamic)
        if valve is None:
            return math.inf
        return window.solve(valve.simulate(window.op, fit.stem0))[1]

    found = scipy.optimize.minimize_scalar(
        cost, bounds=(low, high), method="bounded", options={"xatol": 1e-6 * window.span}
    )
    valve = cell.valve(float(found.x))
    if valve is None:
        return fit
    other = window.fit(valve, fit.stem0)
    return other if other.cost < fit.cost else fit
