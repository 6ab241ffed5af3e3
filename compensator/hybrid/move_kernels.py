"""The search for the best plan of two moves, compiled; `hybrid.moves` states the problem."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from compiled import kernel_for

__all__ = ["best_moves", "best_on_polygon"]

Array = NDArray[np.float64]


@kernel_for(
    "UniTuple(float64, 3)(float64, float64, float64, float64, float64,"
    " float64, float64, float64, float64, float64, float64, float64)",
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


@kernel_for(
    "Tuple((int64, int64, float64, int64, float64, float64))"
    "(float64[:, ::1], float64[::1], int64[::1], UniTuple(float64, 2), UniTuple(float64, 4),"
    " float64, UniTuple(float64, 2), UniTuple(int64, 4))",
)
def best_moves(
    gram: Array,
    correlation: Array,
    times: NDArray[np.int64],
    reach: tuple[float, float],
    least: tuple[float, float, float, float],
    largest: float,
    costs: tuple[float, float],
    ramp: tuple[int, int, int, int],
) -> tuple[int, int, float, int, float, float]:
    """Return moves, first time index, first position, second time index, second position, and the
    cost relative to holding; positions are relative to the present stem.

    ``least`` is the smallest size of a first move up, of a first move down, of a second move in the
    direction of the first, and of one against it; ``largest`` is that of any move unless its
    smallest is larger. ``costs`` are those of a move and of its size, ``ramp`` the first sample of
    a move up, of one down, and the samples between two moves in the same and in opposite
    directions.
    """
    low, high = reach
    first_least_up, first_least_down, on_least, back_least = least
    move_cost, travel_cost = costs
    first_up, first_down, same, opposite = ramp
    count, best_i, best_p, best_j, best_q, best = 0, 0, 0.0, 0, 0.0, 0.0
    n = correlation.size
    for i in range(n):
        hii, gi = gram[i, i], correlation[i]
        if hii <= 0.0:
            continue
        for up in (1.0, -1.0):
            smallest = first_least_up if up > 0.0 else first_least_down
            most = max(largest, smallest)
            p_low = max(low, smallest) if up > 0.0 else max(low, -most)
            p_high = min(high, most) if up > 0.0 else min(high, -smallest)
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
                    second = on_least if on == up else back_least
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
                        second,
                        max(largest, second),
                    )
                    cost = value + 2.0 * move_cost
                    if cost < best:
                        count, best_i, best_p, best_j, best_q, best = 2, i, p, j, q, cost
    return count, best_i, best_p, best_j, best_q, best
