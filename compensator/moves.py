"""Plans of few valve moves, each of size 0 or at least the slip jump: the exact optimum, compiled.

The problem (positions relative to the present stem, ``t_j`` on a grid of move times, ``s`` the
process's step response, ``e`` the error PV would have with the stem at rest):

    min  sum_p w_p (e_p + sum_j D_j s(p - t_j))**2 + sum_j (move_cost + travel_cost |D_j|)
    s.t. |D_j| >= smallest,   low <= stem + D_1 + ... + D_j <= high,   at most two moves

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

import numba
import numpy as np
from numpy.typing import NDArray

from compensator.kernels import correlate, held_course
from compensator.prediction import Prediction, settling_samples

__all__ = ["MovePlan", "MovePlanner", "Ramp", "warm_up"]

Array = NDArray[np.float64]

_LASTING = 1.0
"""Horizons that the error at a horizon's end counts for beyond it."""


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
    """What OP's rate limit asks of a plan; the default is no limit.

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
        horizon: samples; 0 chooses twice the settling time beyond the dead time.
    """

    def __init__(self, prediction: Prediction, horizon: int = 0) -> None:
        self.prediction = prediction
        settle = settling_samples(prediction)
        self.horizon = horizon or min(1500, prediction.dead_time + max(30, 2 * settle))
        points = _spread(1, 24, self.horizon, 0.06)
        latest = max(1, self.horizon - prediction.dead_time) * 2 // 3
        self.times = _spread(0, 12, latest, 0.12)
        self.points = points
        self.weights = np.diff(points, prepend=0).astype(np.float64)
        response = np.concatenate([[0.0], prediction.step_response(self.horizon)])
        shifted = points[None, :] - self.times[:, None]
        self._effects = np.where(shifted > 0, response[np.maximum(shifted, 0)], 0.0)
        self.duration = float(self.weights.sum())
        # What is left at the end stays: it counts for longer than noise that passes.
        self.weights[-1] += _LASTING * self.duration * (not prediction.process.is_integrating)
        self._weighted = np.ascontiguousarray(self._effects * self.weights)
        self.gram = np.ascontiguousarray(self._weighted @ self._effects.T)
        self._held = np.ascontiguousarray(response[points])
        rows = np.empty((points.size, prediction.order))
        row = np.zeros(prediction.order)
        row[0] = 1.0
        k = 1
        for i, p in enumerate(points):
            while k < p:
                row = row @ prediction.A
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
        smallest: float,
        move_cost: float,
        travel_cost: float,
        ramp: Ramp | None = None,
    ) -> MovePlan:
        """Return the best plan.

        Args:
            error: PV minus SP at `points` with the stem at rest, shape ``(points,)``.
            reach: positions that moves may end at, relative to the present one.
            smallest: least size of a move.
            move_cost, travel_cost: price of one move, and of its size, in units of PV squared
                times samples.
            ramp: what OP's rate limit asks; None: nothing.
        """
        r = ramp or Ramp()
        hold, correlation = correlate(self._weighted, self.weights, error)
        count, i, p, j, q, gain = best_moves(
            self.gram,
            correlation,
            self.times,
            reach,
            (smallest, max(smallest, r.largest)),
            (move_cost, travel_cost),
            (r.up, r.down, r.same, r.opposite),
        )
        times = (int(self.times[i]), int(self.times[j]))[:count]
        effects = (self._effects[i, -1] * p, self._effects[j, -1] * (q - p))[:count]
        final = float(error[-1] + sum(effects))
        return MovePlan(times, (p, q)[:count], hold + gain, hold, final)


@numba.njit(
    "UniTuple(float64, 3)(float64, float64, float64, float64, float64,"
    " float64, float64, float64, float64, float64, float64, float64)",
    cache=True,
)
def best_on_polygon(
    hpp: float,
    hpq: float,
    hqq: float,
    gp: float,
    gq: float,
    p_low: float,
    p_high: float,
    q_low: float,
    q_high: float,
    sign: float,
    smallest: float,
    largest: float,
) -> tuple[float, float, float]:
    """Minimise ``hpp p² + 2 hpq p q + hqq q² + 2 gp p + 2 gq q`` over ``p_low <= p <= p_high``,
    ``q_low <= q <= q_high``, ``smallest <= sign (q - p) <= largest``; return value, p, q (value
    infinite when there is no such point).
    """
    if p_low > p_high or q_low > q_high:
        return math.inf, 0.0, 0.0
    det = hpp * hqq - hpq * hpq
    if det > 1e-14 * hpp * hqq:
        p = (hpq * gq - hqq * gp) / det
        q = (hpq * gp - hpp * gq) / det
        size = sign * (q - p)
        if p_low <= p <= p_high and q_low <= q <= q_high and smallest <= size <= largest:
            return gp * p + gq * q, p, q
    best, best_p, best_q = math.inf, 0.0, 0.0
    for edge in range(6):
        if edge == 5 and largest == math.inf:
            continue
        # Along every edge: p = p0 + dp t, q = q0 + dq t with t in [low, high].
        if edge < 2:
            p0, dp, q0, dq = (p_low if edge == 0 else p_high), 0.0, 0.0, 1.0
            low, high = q_low, q_high
            if sign > 0.0:
                low, high = max(low, p0 + smallest), min(high, p0 + largest)
            else:
                low, high = max(low, p0 - largest), min(high, p0 - smallest)
        elif edge < 4:
            p0, dp, q0, dq = 0.0, 1.0, (q_low if edge == 2 else q_high), 0.0
            low, high = p_low, p_high
            if sign > 0.0:
                low, high = max(low, q0 - largest), min(high, q0 - smallest)
            else:
                low, high = max(low, q0 + smallest), min(high, q0 + largest)
        else:
            p0, dp, q0, dq = 0.0, 1.0, sign * (smallest if edge == 4 else largest), 1.0
            low, high = max(p_low, q_low - q0), min(p_high, q_high - q0)
        if low > high:
            continue
        curve = hpp * dp * dp + 2.0 * hpq * dp * dq + hqq * dq * dq
        slope = (hpp * p0 + hpq * q0 + gp) * dp + (hpq * p0 + hqq * q0 + gq) * dq
        t = -slope / curve if curve > 0.0 else (high if slope < 0.0 else low)
        t = min(max(t, low), high)
        p, q = p0 + dp * t, q0 + dq * t
        value = hpp * p * p + 2.0 * hpq * p * q + hqq * q * q + 2.0 * (gp * p + gq * q)
        if value < best:
            best, best_p, best_q = value, p, q
    return best, best_p, best_q


@numba.njit(
    "Tuple((int64, int64, float64, int64, float64, float64))"
    "(float64[:, ::1], float64[::1], int64[::1], UniTuple(float64, 2), UniTuple(float64, 2),"
    " UniTuple(float64, 2), UniTuple(int64, 4))",
    cache=True,
)
def best_moves(
    gram: Array,
    correlation: Array,
    times: NDArray[np.int64],
    reach: tuple[float, float],
    sizes: tuple[float, float],
    costs: tuple[float, float],
    ramp: tuple[int, int, int, int],
) -> tuple[int, int, float, int, float, float]:
    """Return moves, first time index, first position, second time index, second position, and the
    cost relative to holding; positions are relative to the present stem.

    ``sizes`` are the smallest and the largest of a move, ``costs`` those of a move and of its size,
    ``ramp`` the first sample of a move up, of one down, and the samples between two moves in the
    same and in opposite directions.
    """
    low, high = reach
    smallest, largest = sizes
    move_cost, travel_cost = costs
    first_up, first_down, same, opposite = ramp
    count, best_i, best_p, best_j, best_q, best = 0, 0, 0.0, 0, 0.0, 0.0
    n = correlation.size
    for i in range(n):
        hii, gi = gram[i, i], correlation[i]
        if hii <= 0.0:
            continue
        for up in (1.0, -1.0):
            p_low = max(low, smallest) if up > 0.0 else max(low, -largest)
            p_high = min(high, largest) if up > 0.0 else min(high, -smallest)
            if p_low > p_high or times[i] < (first_up if up > 0.0 else first_down):
                continue
            g = gi + 0.5 * travel_cost * up
            p = min(max(-g / hii, p_low), p_high)
            cost = hii * p * p + 2.0 * g * p + move_cost
            if cost < best:
                count, best_i, best_p, best = 1, i, p, cost
            for j in range(i + 1, n):
                hjj, hij, gj = gram[j, j], gram[i, j], correlation[j]
                if hjj <= 0.0:
                    continue
                det = hii * hjj - hij * hij
                # No pair of sizes does better than the unconstrained pair.
                if det > 1e-12 * hii * hjj:
                    bound = -(hjj * gi * gi - 2.0 * hij * gi * gj + hii * gj * gj) / det
                    if bound + 2.0 * move_cost >= best:
                        continue
                # In positions p and q after the moves: sizes are p and q - p.
                for on in (1.0, -1.0):
                    if times[j] - times[i] < (same if on == up else opposite):
                        continue
                    a = gi + 0.5 * travel_cost * up
                    b = gj + 0.5 * travel_cost * on
                    value, p, q = best_on_polygon(
                        hii - 2.0 * hij + hjj,
                        hij - hjj,
                        hjj,
                        a - b,
                        b,
                        p_low,
                        p_high,
                        low,
                        high,
                        on,
                        smallest,
                        largest,
                    )
                    cost = value + 2.0 * move_cost
                    if cost < best:
                        count, best_i, best_p, best_j, best_q, best = 2, i, p, j, q, cost
    return count, best_i, best_p, best_j, best_q, best


def warm_up() -> None:
    """Load the compiled kernels (compile them on a first run), ahead of the first deadline."""
    times = np.arange(2, dtype=np.int64)
    best_moves(np.eye(2), np.ones(2), times, (-1.0, 1.0), (0.1, 1.0), (0.01, 0.01), (0, 0, 1, 1))
