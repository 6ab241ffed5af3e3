"""Plans of few valve moves, each of size 0 or at least the slip jump: the exact optimum, compiled.

The problem (positions relative to the present stem, ``t_j`` on a grid of move times, ``s`` the
process's step response, ``e`` the error PV would have with the stem at rest):

    min  sum_p w_p (e_p + sum_j D_j s(p - t_j))**2 + sum_j (move_cost + travel_cost |D_j|)
    s.t. |D_j| >= least,   low <= stem + D_1 + ... + D_j <= high,   at most two moves

The least size of a move may depend on its direction and on the one before (`LeastMoves`): what is
believed of the dynamic friction changes what a command that is sure to slip makes of the drive.
A rate limit of OP makes the first slip wait, keeps slips apart and bounds their size (`Ramp`).

For given times and signs it is a convex quadratic in one or two unknowns on a polygon, solved in
closed form: the interior optimum if it is inside, else the best point of the polygon's edges. All
times and signs are tried, so the result is the global optimum on the grid of times.

``w_p`` and the points ``p`` are dense at first and grow sparser; each point's weight is the stretch
it stands for, so the far points carry the lasting offset (or the drift of an integrating process).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compensator.hybrid.move_kernels import best_moves
from compensator.hybrid.settings import HybridSettings
from compensator.kernels import correlate, gram_of, held_course, multiplied
from compensator.prediction import Prediction, settling_samples

__all__ = ["LeastMoves", "MovePlan", "MovePlanner", "Ramp", "warm_up"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MovePlan:
    """The best plan found.

    Attributes:
        times: sample of each move from now (0 is this scan); empty when holding is best.
        changes: stem position after each move, relative to the present one.
        cost: of the plan, costs of the moves included; hold_cost: of doing nothing.
        final_pv: PV minus SP at the end of the horizon under the plan.
    """

    times: tuple[int, ...]
    changes: tuple[float, ...]
    cost: float
    hold_cost: float
    final_pv: float


@dataclass(frozen=True, slots=True)
class Ramp:
    """The limits that OP's rate sets to a plan; the default has none.

    Attributes:
        up, down: samples before OP can have made the stem slip upwards, downwards.
        same, opposite: samples between a slip and the next in the same, in the other direction.
        largest: size of one slip.
    """

    up: int = 0
    down: int = 0
    same: int = 1
    opposite: int = 1
    largest: float = math.inf


@dataclass(frozen=True, slots=True)
class LeastMoves:
    """Least sizes of moves, all above zero or all zero.

    Attributes:
        up, down: of a first move upwards, downwards.
        on: of a second move in the direction of the first.
        back: of a second move against the first.
    """

    up: float
    down: float
    on: float
    back: float

    @classmethod
    def alike(cls, size: float) -> LeastMoves:
        """Return one least size for all moves."""
        return cls(size, size, size, size)


def _spread(first: int, dense: int, last: int, ratio: float) -> NDArray[np.int64]:
    """Return integers from ``first`` to ``last``: every one up to ``dense``, then ever sparser."""
    points = [first]
    while points[-1] < last:
        gap = 1 if points[-1] < dense else max(1, int(points[-1] * ratio))
        points.append(min(points[-1] + gap, last))
    return np.asarray(points, dtype=np.int64)


class MovePlanner:
    """Everything of the planning problem that does not change from scan to scan, and its solver.

    Args:
        prediction: the process.
        settings: ``horizon`` (0 chooses twice the settling time beyond the dead time, for a level
            ``level_horizon``) and ``lasting``.
        on_ramp: whether the set-point goes on, so that no error lasts.
    """

    def __init__(
        self,
        prediction: Prediction,
        settings: HybridSettings | None = None,
        *,
        on_ramp: bool = False,
    ) -> None:
        s = settings or HybridSettings()
        horizon, lasting = s.horizon, 0.0 if on_ramp else s.lasting
        self.prediction = prediction
        self.settling = settle = settling_samples(prediction)
        beyond = s.level_horizon if prediction.process.is_integrating else max(30, 2 * settle)
        self.horizon = horizon or min(1500, prediction.dead_time + beyond)
        points = _spread(1, 24, self.horizon, 0.06)
        latest = max(1, self.horizon - prediction.dead_time) * 2 // 3
        self.times = _spread(0, 12, latest, 0.12)
        self.points = points
        self.weights = np.diff(points, prepend=0).astype(np.float64)
        response = np.concatenate([[0.0], prediction.step_response(self.horizon)])
        shifted = points[None, :] - self.times[:, None]
        self._effects = np.where(shifted > 0, response[np.maximum(shifted, 0)], 0.0)
        if lasting and not horizon and not prediction.process.is_integrating:
            # The last point stands for what lasts. A move shortly before it must not make it look
            # good by a way there and back that has not settled: such a plan is put off for ever.
            self._effects[:, -1] = prediction.process.gain
        self.duration = float(self.weights.sum())
        # What is left at the end stays: it counts for longer than noise that passes.
        self.weights[-1] += lasting * self.duration * (not prediction.process.is_integrating)
        self._weighted = np.ascontiguousarray(self._effects * self.weights)
        self.gram = gram_of(self._weighted, np.ascontiguousarray(self._effects))
        self._held = np.ascontiguousarray(response[points])
        # What grows at the input has shown in PV up to now: without the dead time.
        late = prediction.dead_time - 1
        at_once = prediction.step_response(self.horizon + late)[late:]
        self.ramp_response = np.cumsum(at_once)[points - 1]
        rows = np.empty((points.size, prediction.order))
        row = np.zeros(prediction.order)
        row[0] = 1.0
        transposed = np.ascontiguousarray(prediction.A.T)
        k = 1
        for i, p in enumerate(points):
            while k < p:
                row = multiplied(transposed, row)
                k += 1
            rows[i] = row
        self._free = rows

    def held_pv(self, state: Array, drive: float) -> Array:
        """Return PV at `points` if ``drive`` (stem and load) stays; ``state`` is the next scan's
        without it.
        """
        return held_course(self._free, self._held, state, drive)

    def plan(
        self,
        error: Array,
        reach: tuple[float, float],
        least: LeastMoves,
        move_cost: float,
        travel_cost: float,
        ramp: Ramp | None = None,
        within: float = math.inf,
    ) -> MovePlan:
        """Return the best plan.

        Args:
            error: PV minus SP at `points` with the stem at rest, shape ``(points,)``.
            reach: positions that moves may end at, relative to the present one.
            least: least sizes of the moves.
            move_cost, travel_cost: price of one move, and of its size, in units of PV squared
                times samples.
            ramp: what OP's rate limit asks; None: nothing.
            within: samples whose error counts; what comes later is left to later plans.
        """
        r = ramp or Ramp()
        weighted, weights, gram = self._weighted, self.weights, self.gram
        if within < self.horizon:
            weights = np.where(self.points <= within, weights, 0.0)
            weighted = np.ascontiguousarray(self._effects * weights)
            gram = gram_of(weighted, np.ascontiguousarray(self._effects))
        hold, correlation = correlate(weighted, weights, error)
        count, i, p, j, q, gain = best_moves(
            gram,
            correlation,
            self.times,
            reach,
            (least.up, least.down, least.on, least.back),
            max(least.on, r.largest),
            (move_cost, travel_cost),
            (r.up, r.down, r.same, r.opposite),
        )
        times = (int(self.times[i]), int(self.times[j]))[:count]
        effects = (self._effects[i, -1] * p, self._effects[j, -1] * (q - p))[:count]
        final = float(error[-1] + math.fsum(effects))
        return MovePlan(times, (p, q)[:count], hold + gain, hold, final)


def warm_up() -> None:
    """Load the compiled kernels (compile them on a first run), ahead of the first deadline."""
    times = np.arange(2, dtype=np.int64)
    least = (0.1, 0.1, 0.1, 0.1)
    best_moves(np.eye(2), np.ones(2), times, (-1.0, 1.0), least, 1.0, (0.01, 0.01), (0, 0, 1, 1))
