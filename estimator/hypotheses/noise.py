"""The noise model: residuals as an autoregression, its order chosen by BIC."""

from __future__ import annotations

import math

import numpy as np

from compiled import kernel
from estimator.algebra import dot, is_stable, solve_spd
from estimator.arrays import Array, Index
from estimator.rows import Rows
from estimator.settings import Modelling

__all__ = ["DRIFT", "DRIFT_AND_NOISE", "LOOKS", "WHITE", "best_order", "fit_noise", "orders_of"]

WHITE: Array = np.zeros(0)
"""The noise model of white noise: no taps."""

DRIFT: Array = np.array([0.95])
"""Nearly a random walk: loads that wander, a sensor without noise."""

DRIFT_AND_NOISE: Array = 0.39 * 0.6 ** np.arange(8.0)
"""A random walk under white noise: ``(1 - 0.99 z^-1) / (1 - 0.6 z^-1)``, cut after eight taps."""

LOOKS: tuple[Array, ...] = (WHITE, DRIFT_AND_NOISE)
"""The noise models of the first look; the noise of loops lies between them, and valves that `DRIFT`
shows are shown by one-step errors as well (tuning family: none lost)."""


_RIDGE = 1e-9
"""Share added to the diagonal of the products: residuals without noise have a singular one."""
_TIE = 1e-9
"""Nats by which an order must be better: rounding decides nothing."""


@kernel
def _products(residual: Array, weight: Array, order: int, first: int) -> Array:
    """Products ``(order + 1, order + 1)`` of the residual's last values over the judged rows.

    A product one sample earlier is the same sum one row earlier: only the ends of each run of
    judged rows differ.
    """
    n = residual.size
    out = np.zeros((order + 1, order + 1))
    begin = first
    while begin < n:
        if weight[begin] == 0.0:
            begin += 1
            continue
        end = begin
        while end < n and weight[end] != 0.0:
            end += 1
        for i in range(order + 1):
            out[0, i] += dot(residual[begin:end], residual[begin - i : end - i])
        for i in range(order):
            for j in range(i, order):
                gained = residual[begin - 1 - i] * residual[begin - 1 - j]
                out[i + 1, j + 1] += gained - residual[end - 1 - i] * residual[end - 1 - j]
        begin = end
    for i in range(order):
        for j in range(i, order):
            out[i + 1, j + 1] += out[i, j]
    for i in range(order + 1):
        for j in range(i):
            out[i, j] = out[j, i]
    return out


@kernel
def _stabilised(taps: Array, largest: float) -> Array:
    """The taps with their poles drawn towards zero until the noise model is stable."""
    shrunk = taps.copy()
    factor = 1.0
    while shrunk.size > 0 and not is_stable(shrunk, largest):
        factor *= 0.99
        power = 1.0
        for i in range(taps.size):
            power *= factor
            shrunk[i] = taps[i] * power
    return shrunk


def orders_of(rows: Rows, settings: Modelling) -> Index:
    """The orders that the rows leave past for."""
    return np.array([p for p in settings.noise_orders if p < rows.first], dtype=np.int64)


def fit_noise(rows: Rows, residual: Array, settings: Modelling) -> Array:
    """Taps ``(p,)`` of ``v_k = taps_1 v_(k-1) + ... + e_k`` for a residual ``(n,)``.

    Least squares over the judged rows; the order minimises BIC.
    """
    found: Array = best_order(
        residual,
        rows.weight,
        rows.count,
        rows.floor,
        rows.first,
        orders_of(rows, settings),
        settings.max_reflection,
    )
    return found


@kernel
def best_order(
    residual: Array,
    weight: Array,
    count: float,
    floor: float,
    first: int,
    orders: Index,
    largest: float,
) -> Array:
    """The taps of the order of least BIC."""
    products = _products(residual, weight, orders.max(), first)
    best, found = np.inf, np.zeros(0)
    for p in orders:
        gram = products[1 : p + 1, 1 : p + 1].copy()
        for i in range(p):
            gram[i, i] *= 1.0 + _RIDGE
        taps = _stabilised(solve_spd(gram, products[0, 1 : p + 1].copy()), largest)
        # of the innovations: the products say it for any taps
        squares = products[0, 0]
        for i in range(p):
            squares -= 2.0 * taps[i] * products[0, i + 1]
            for j in range(p):
                squares += taps[i] * taps[j] * products[i + 1, j + 1]
        cost = count * math.log(max(squares, 0.0) / count + floor) + p * math.log(count)
        if cost < best - _TIE:
            best, found = cost, taps
    return found
