"""The one-step-ahead criterion: ARX(na, nb) with intercept, equations (7)-(13) of the paper.

For a given stem the coefficients are linear least squares. The columns that all stems share (the
intercept and PV's past) are projected out once, so that a candidate costs a few inner products and
an ``nb`` by ``nb`` system.

The dead time is one sample or more: with direct feed-through the regression may learn the
controller, which answers PV within the same scan, instead of the process.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator._kernels import Array, Mask, lagged_products
from estimator.window import Window
from loop_model import ProcessModel

__all__ = ["ArxFit", "ArxOrders", "ArxRegression", "select_orders"]

_MAX_NA = 6
_MAX_NB = 3
_MAX_DEAD_TIME = 12


@dataclass(frozen=True, slots=True)
class ArxOrders:
    """Orders and dead time of an ARX model, with the BIC they reached over ``rows`` samples."""

    na: int
    nb: int
    dead_time: int
    bic: float = math.nan
    rows: int = 0

    @property
    def name(self) -> str:
        """``arx(na,nb)``."""
        return f"arx({self.na},{self.nb})"

    @property
    def lead(self) -> int:
        """Samples that the oldest regressor reaches back."""
        return max(self.na, self.dead_time + self.nb - 1)


@dataclass(frozen=True, slots=True)
class ArxFit:
    """Coefficients in scaled units, and what they predict one step ahead."""

    a: Array
    b: Array
    offset: float
    residual: Array

    def simulate(self, stem: Array, start: Array, dead_time: int) -> Array:
        """PV simulated from the stem alone, shape ``(n,)``; ``start`` is PV before sample 0."""
        model = ProcessModel(tuple(self.a), tuple(self.b), dead_time, self.offset, 1.0)
        return model.simulate(stem, pv0=start)

    def process(self, window: Window, dead_time: int) -> ProcessModel:
        """The same model in units of OP and PV."""
        b = self.b * (window.pv_scale / window.op_span)
        level = window.pv_centre * (1.0 + self.a.sum()) + window.pv_scale * self.offset
        return ProcessModel(
            a=tuple(float(v) for v in self.a),
            b=tuple(float(v) for v in b),
            dead_time=dead_time,
            offset=float(level - b.sum() * window.op_centre),
            period=window.period,
        )


class ArxRegression:
    """Least squares of PV one step ahead, for many stems at once."""

    def __init__(self, y: Array, good: Mask, orders: ArxOrders) -> None:
        self.orders = orders
        usable = good.copy()
        for i in range(1, orders.na + 1):
            usable[i:] &= good[:-i]
        usable[: orders.lead] = False
        self.weight = usable.astype(np.float64)
        self.count = float(self.weight.sum())
        self._target = y * self.weight
        past = [np.ones(y.size), *(_late(y, i) for i in range(1, orders.na + 1))]
        self._past = np.stack(past, axis=1) * self.weight[:, None]
        basis, _ = np.linalg.qr(self._past)
        rest = self._target - basis @ (basis.T @ self._target)
        rows = np.vstack([rest, basis.T])
        delays = range(orders.dead_time, orders.dead_time + orders.nb)
        self._stack = np.vstack([_early(rows, d) for d in delays])
        self._energy = float(rest @ rest)

    def costs(self, stem: Array) -> tuple[Array, Array]:
        """Residual sum of squares and steady-state gain, shape ``(m,)``, for stems ``(n, m)``."""
        nb, m = self.orders.nb, stem.shape[1]
        products = (self._stack @ stem).reshape(nb, -1, m)
        gram = self._gram(stem, products)
        right = np.ascontiguousarray(products[:, 0].T)
        scale = np.einsum("mii->m", gram) / nb
        gram += (1e-9 * scale + 1e-12)[:, None, None] * np.eye(nb)
        b: Array = np.linalg.solve(gram, right[:, :, None])[:, :, 0].astype(np.float64)
        cost = self._energy - np.einsum("mi,mi->m", b, right)
        # PV's past given b: the projection of what the stem leaves unexplained
        past = self._alpha(products, b)
        gain = b.sum(axis=1) / (1.0 + past.sum(axis=1))
        return np.maximum(cost, 1e-12 * self._energy + 1e-300), gain

    def solve(self, stem: Array) -> ArxFit:
        """Coefficients for one stem, shape ``(n,)``."""
        o = self.orders
        late = [_late(stem, d) for d in range(o.dead_time, o.dead_time + o.nb)]
        design = np.hstack([self._past, np.stack(late, axis=1) * self.weight[:, None]])
        found, *_ = np.linalg.lstsq(design, self._target, rcond=1e-10)
        solution: Array = found.astype(np.float64)
        return ArxFit(
            a=-solution[1 : 1 + o.na],
            b=solution[1 + o.na :],
            offset=float(solution[0]),
            residual=self._target - design @ solution,
        )

    def gain_deviation(self, fit: ArxFit, stem: Array) -> float:
        """Standard deviation of the steady-state gain for a known stem (delta method)."""
        o = self.orders
        late = [_late(stem, d) for d in range(o.dead_time, o.dead_time + o.nb)]
        design = np.hstack([self._past, np.stack(late, axis=1) * self.weight[:, None]])
        free = design.shape[1]
        variance = float(np.square(fit.residual).sum()) / max(1.0, self.count - free)
        rest = 1.0 + float(fit.a.sum())
        gain = float(fit.b.sum()) / rest
        slope = np.concatenate([[0.0], np.full(o.na, gain), np.ones(o.nb)]) / rest
        spread = np.linalg.lstsq(design.T @ design, slope, rcond=1e-12)[0]
        return float(np.sqrt(max(0.0, variance * float(slope @ spread))))

    def _gram(self, stem: Array, products: Array) -> Array:
        o = self.orders
        sums = lagged_products(stem, self.weight, o.dead_time, o.nb)
        gram = np.empty((stem.shape[1], o.nb, o.nb))
        for i in range(o.nb):
            for j in range(i, o.nb):
                shared = np.einsum("km,km->m", products[i, 1:], products[j, 1:])
                gram[:, i, j] = gram[:, j, i] = sums[i, j] - shared
        return gram

    def _alpha(self, products: Array, b: Array) -> Array:
        """Coefficients ``a`` of PV's past, shape ``(m, na)``."""
        basis, root = np.linalg.qr(self._past)
        straight = basis.T @ self._target
        through = np.einsum("ikm,mi->mk", products[:, 1:], b)
        solved = np.linalg.solve(root, (straight[None] - through).T).T
        return np.asarray(-solved[:, 1:])


def select_orders(y: Array, good: Mask, stem: Array) -> list[ArxOrders]:
    """ARX orders and dead times by BIC for one stem, best first.

    All models are fitted to the same rows, so that their BIC compare.
    """
    n = y.size
    longest = min(_MAX_DEAD_TIME, n // 12)
    lead = max(_MAX_NA, longest + _MAX_NB)
    delays = range(1, longest + _MAX_NB)
    columns = [np.ones(n), *(_late(y, i) for i in range(1, _MAX_NA + 1))]
    columns += [_late(stem, d) for d in delays] + [y]
    usable = good.copy()
    for i in range(1, _MAX_NA + 1):
        usable[i:] &= good[:-i]
    usable[:lead] = False
    design = np.stack(columns, axis=1)[usable]
    count = design.shape[0]
    gram = design.T @ design
    found = []
    for na in range(1, _MAX_NA + 1):
        for nb in range(1, _MAX_NB + 1):
            for d in range(1, longest + 1):
                index = [*range(na + 1), *range(_MAX_NA + d, _MAX_NA + d + nb)]
                block, right = gram[np.ix_(index, index)], gram[index, -1]
                ridge = 1e-10 * np.diag(np.diag(block)) + 1e-12 * np.eye(len(index))
                rss = float(gram[-1, -1] - right @ np.linalg.solve(block + ridge, right))
                rss = max(rss, 1e-12 * float(gram[-1, -1]) + 1e-300)
                # parameters: coefficients, intercept, dead time
                bic = count * math.log(rss / count) + (len(index) + 1) * math.log(count)
                found.append(ArxOrders(na, nb, d, bic, count))
    return sorted(found, key=lambda orders: orders.bic)


def _late(signal: Array, samples: int) -> Array:
    """``signal`` later by ``samples``, its first value held."""
    if samples == 0:
        return signal
    return np.concatenate([np.full(samples, signal[0]), signal[:-samples]])


def _early(rows: Array, samples: int) -> Array:
    if samples == 0:
        return rows
    out = np.zeros_like(rows)
    out[:, :-samples] = rows[:, samples:]
    return out
