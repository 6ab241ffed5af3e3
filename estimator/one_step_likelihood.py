"""The likelihood of one-step errors, of a window and of its first samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator._kernels import Array, Mask
from estimator._one_step import OneStep
from estimator.arx import MAX_NB, ArxOrders, ArxRegression

__all__ = ["OneStepLikelihood"]


class OneStepLikelihood:
    """Of valves, with the ``orders`` of a search and every dead time near their own.

    All ``b`` that the regression can hold are in it: a stick band and a dead time trade against
    each other, and what may be either must not be held. ``y`` is scaled PV and ``good`` marks the
    samples that count, ``(n,)``; ``variance`` is about that of the errors.
    """

    def __init__(self, y: Array, good: Mask, orders: ArxOrders, variance: float) -> None:
        shorter = (MAX_NB - orders.nb + 1) // 2
        self._y, self._good = y, good
        self._orders = replace(orders, nb=MAX_NB, dead_time=max(1, orders.dead_time - shorter))
        self._variance = variance
        self._regressions: dict[int, ArxRegression] = {}

    def tables(self, samples: int) -> OneStep:
        """What the compiled sums need of the first ``samples``."""
        return self._regression(samples).tables

    def log(self, samples: int, cost: Array) -> Array:
        """Log-likelihoods of costs over the first ``samples``, ``(m,)``."""
        if samples < self._y.size:
            # too short to tell how large the errors are
            return -0.5 * cost / self._variance
        return -0.5 * self._regression(samples).count * np.log(cost)

    def _regression(self, samples: int) -> ArxRegression:
        if samples not in self._regressions:
            self._regressions[samples] = ArxRegression(
                self._y[:samples], self._good[:samples], self._orders
            )
        return self._regressions[samples]
