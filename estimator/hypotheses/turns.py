"""Process and noise model of one hypothesis in turn: one compiled step for what fits ask most."""

from __future__ import annotations

from compiled import kernel
from estimator.arrays import Array, Index
from estimator.hypotheses.linear_fit import LinearFit, fit_rows
from estimator.hypotheses.noise import best_order
from estimator.lanes import respond_one
from estimator.processes.poles import SHAPE_NUMBERS, Poles, coefficients_of_one
from estimator.rows import Rows

__all__ = ["fit_in_turn"]


def fit_in_turn(
    rows: Rows,
    stem: Array,
    poles: Poles,
    dead_time: int,
    columns: Array,
    taps: Array,
    orders: Index,
    max_reflection: float,
) -> tuple[LinearFit, Array]:
    """Linear part of a stem ``(n,)`` through a process, with the noise model fitted to what it
    leaves.

    The linear part is fitted under the given ``taps``, then the noise model, then the linear part
    again. Without ``orders`` the noise model stays as it is.
    """
    solution, squares, residual, found = _in_turn(
        rows.y,
        stem,
        (SHAPE_NUMBERS[poles.shape], poles.slow, poles.fast, poles.third),
        dead_time,
        columns,
        taps,
        rows.weight,
        rows.sign,
        (rows.count, rows.floor, rows.first, max_reflection),
        orders,
    )
    return LinearFit(solution[:2], solution[2:], squares, residual), found


@kernel
def _in_turn(
    y: Array,
    stem: Array,
    poles: tuple[int, float, float, float],
    dead_time: int,
    columns: Array,
    taps: Array,
    weight: Array,
    sign: float,
    noise: tuple[float, float, int, float],
    orders: Index,
) -> tuple[Array, float, Array, Array]:
    """Solution ``(2 + m,)``, sum of squares, residual ``(n,)`` and taps of `fit_in_turn`."""
    shape, slow, fast, third = poles
    count, floor, first, max_reflection = noise
    c1, c2, last, gain = coefficients_of_one(shape, slow, fast, third)
    response = respond_one(stem, c1, c2, last, gain)
    found = fit_rows(y, response, dead_time, columns, taps, weight, sign)
    if orders.size > 0:
        taps = best_order(found[2], weight, count, floor, first, orders, max_reflection)
        found = fit_rows(y, response, dead_time, columns, taps, weight, sign)
    return found[0], found[1], found[2], taps
