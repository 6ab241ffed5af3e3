"""How much PV fluctuates while the stem rests: measured, not derived from a model of the noise.

A process with lags makes much of a small equation noise; where the noise enters elsewhere, a
noise model claims fluctuations that PV does not show, and an error that is worth a move passes
for noise. What PV does around its own running mean, with the stem at rest, is an upper bound.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from compensator.kernels import lagged_products, next_state
from compensator.prediction import Prediction

__all__ = ["RestFluctuation", "held_correlations"]


class RestFluctuation:
    """Variance of PV around its running mean at rest, one `push` a scan.

    Args:
        settle: samples that a move of the stem takes to settle: they are left out.
        memory: samples of the running mean.
    """

    def __init__(self, settle: int, memory: int) -> None:
        self._settle, self._memory = settle, memory
        self._rested = self._count = 0
        self._mean = self._variance = 0.0
        self.variance = math.inf

    def push(self, pv: float, *, moved: bool) -> None:
        """Take in PV; ``moved`` tells that the stem has moved since the last one."""
        if moved:
            self._rested = self._count = 0
            return
        self._rested += 1
        if self._rested <= self._settle:
            return
        self._count += 1
        share = 1.0 / min(self._count, self._memory)
        ahead = pv - self._mean if self._count > 1 else 0.0
        self._mean = self._mean + share * ahead if self._count > 1 else pv
        self._variance = (1.0 - share) * (self._variance + share * ahead**2)
        if 2 * self._count >= self._memory:
            self.variance = self._variance


@lru_cache(maxsize=8)  # every tracker of a bank asks for the same few
def held_correlations(prediction: Prediction) -> NDArray[np.float64]:
    """Return the autocovariance (lag 0, 1, ...) of what unit equation noise makes of PV with
    the stem held; of an integrating process (it has no limit there) of what comes up within 20
    samples and the dead time.
    """
    p = prediction
    most = p.dead_time + 20 if p.process.is_integrating else 400
    response = np.empty(most + 1)
    response[0] = 1.0
    state = p.equation_gain
    for k in range(1, most + 1):
        response[k] = state[0]
        state = next_state(p.A, state)
    return lagged_products(response)
