"""The one-step-ahead criterion: ARX(na, nb) with intercept, equations (7)-(13) of the paper.

For a given stem the coefficients are linear least squares. The columns that all stems share (the
intercept and PV's past) are projected out once, so that a candidate costs a few sums over its slips
and an ``nb`` by ``nb`` system.

The dead time is one sample or more: with direct feed-through the regression may learn the
controller, which answers PV within the same scan, instead of the process.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator._kernels import Array, Mask, complete, lagged
from estimator._one_step import OneStep, recursion, residual_sums
from estimator._past import past_of, slip_table, unexplained
from estimator.window import Window
from loop_model import ProcessModel

__all__ = ["MAX_NB", "ArxFit", "ArxOrders", "ArxRegression", "select_orders"]

MAX_NB = 3
"""The most coefficients on the stem that are tried."""
_MAX_NA = 6
_MAX_DEAD_TIME = 20
_RANKED = 12


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

    @property
    def gain(self) -> float:
        """Steady-state gain in scaled units, infinite for an exact integrator."""
        rest, through = 1.0 + float(self.a.sum()), float(self.b.sum())
        return through / rest if rest != 0.0 else math.copysign(math.inf, through)

    def simulate(self, stem: Array, start: Array, dead_time: int) -> Array:
        """PV simulated from the stem alone, shape ``(n,)``; ``start`` is PV before sample 0."""
        drive = np.full(stem.size, self.offset)
        for i, b in enumerate(self.b):
            drive += b * _late(stem, dead_time + i)
        simulated: Array = recursion(self.a, drive, np.ascontiguousarray(start, dtype=np.float64))
        return simulated

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
        usable = complete(good, orders.na)
        usable[: orders.lead] = False
        self.weight = usable.astype(np.float64)
        self.count = float(self.weight.sum())
        self._target = y * self.weight
        past = past_of(y, orders.na, self.weight)
        self._past = past
        rows = unexplained(y, self.weight, past)
        rest, basis = rows[0], rows[1:]
        straight = basis @ self._target
        # what the past's coefficients of PV add up to, for a part of PV given in the basis
        ones = np.concatenate([[0.0], np.ones(orders.na)])
        root = np.triu(basis @ past.T)
        root[np.diag_indices_from(root)] += np.where(np.diag(root) == 0.0, 1.0, 0.0)
        summing = np.linalg.solve(root.T, ones)
        self.tables = OneStep(
            slip_table(rows, self.weight, orders.dead_time, 2, y.size),
            rows.shape[0],
            orders.nb,
            float(rest @ rest),
            np.concatenate([[1.0 - float(summing @ straight)], summing]),
        )

    def solve(self, stem: Array) -> ArxFit:
        """Coefficients for one stem, shape ``(n,)``."""
        o = self.orders
        design = self._design(stem)
        found, *_ = np.linalg.lstsq(design, self._target, rcond=1e-10)
        solution: Array = found.astype(np.float64)
        return ArxFit(
            a=-solution[1 : 1 + o.na],
            b=solution[1 + o.na :],
            offset=float(solution[0]),
            residual=self._target - design @ solution,
        )

    def _design(self, stem: Array) -> Array:
        """Regressors, ``(n, 1 + na + nb)``: the intercept, PV's past and the stem's."""
        late = lagged(stem, self.orders.dead_time, self.orders.nb, self.weight)
        return np.vstack([self._past, late]).T

    def gain_deviation(self, fit: ArxFit, stem: Array) -> float:
        """Standard deviation of the steady-state gain for a known stem (delta method).

        Infinite where the gain is.
        """
        if math.isinf(fit.gain):
            return math.inf
        o = self.orders
        design = self._design(stem)
        free = design.shape[1]
        variance = float(np.square(fit.residual).sum()) / max(1.0, self.count - free)
        inside = np.concatenate([[0.0], np.full(o.na, fit.gain), np.ones(o.nb)])
        slope = inside / (1.0 + float(fit.a.sum()))
        spread = np.linalg.lstsq(design.T @ design, slope, rcond=1e-12)[0]
        return float(np.sqrt(max(0.0, variance * float(slope @ spread))))


def select_orders(y: Array, good: Mask, stem: Array) -> list[ArxOrders]:
    """The dozen best ARX orders and dead times by BIC for one stem, best first.

    All models are fitted to the same rows, so that their BIC compare.
    """
    n = y.size
    longest = min(_MAX_DEAD_TIME, n // 12)
    lead = max(_MAX_NA, longest + MAX_NB)
    usable = complete(good, _MAX_NA)
    usable[:lead] = False
    weight = usable.astype(np.float64)
    past = past_of(y, _MAX_NA, weight)
    design = np.vstack(
        [past, lagged(stem, 1, longest + MAX_NB - 1, weight), np.where(usable, y, 0.0)]
    )
    count = int(usable.sum())
    gram = design @ design.T
    rss = residual_sums(gram, _MAX_NA, MAX_NB, longest)
    na, nb, d = np.ogrid[1 : _MAX_NA + 1, 1 : MAX_NB + 1, 1 : longest + 1]
    # parameters: coefficients, intercept, dead time
    bic = count * np.log(rss / count) + (na + nb + 2 + 0 * d) * math.log(count)
    best = np.argsort(bic, axis=None, kind="stable")[:_RANKED]
    return [
        ArxOrders(int(i) + 1, int(j) + 1, int(k) + 1, float(bic[i, j, k]), count)
        for i, j, k in zip(*np.unravel_index(best, bic.shape), strict=True)
    ]


def _late(signal: Array, samples: int) -> Array:
    """``signal`` later by ``samples``, its first value held."""
    if samples == 0:
        return signal
    return np.concatenate([np.full(samples, signal[0]), signal[:-samples]])
