"""The quadratic cost of problem (16) of the paper with the states eliminated (condensed form).

With ``z`` the inputs' distance from their steady target (one a sample of the horizon) and ``d`` the
distance of the next scan's state, were the input at its target, from the target state:

    sum_i (xi_i - xi_s)^T Q (xi_i - xi_s) + (xi_N - xi_s)^T V_F (xi_N - xi_s)
        = z^T hessian z + 2 z^T (linear d) + what no input changes

``V_F`` is the Riccati solution for Q and the price of inputs, hence without active limits the
finite horizon's optimum is the linear-quadratic regulator's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compensator.prediction import Prediction
from compensator.riccati import solve_riccati

__all__ = ["CondensedCost"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CondensedCost:
    """Matrices of the cost, and those that give PV.

    Attributes:
        hessian: shape ``(N, N)``, of PV alone (the price of inputs is not in it).
        linear: shape ``(N, n)``.
        free: shape ``(N, n)``, PV from ``d``; forced: shape ``(N, N)``, PV from ``z``.
        op_weight: price of the squared distance of OP from its target, scaled to PV.
    """

    hessian: Array
    linear: Array
    free: Array
    forced: Array
    op_weight: float

    @classmethod
    def of(
        cls, prediction: Prediction, horizon: int, pv_weight: float, op_weight: float
    ) -> CondensedCost:
        """Eliminate the states.

        Args:
            prediction: the process.
            horizon: samples beyond the dead time.
            pv_weight: Q of (16a) on PV.
            op_weight: R of (16a) on OP counted in the PV it makes (`Prediction.scale`).
        """
        p = prediction
        samples = horizon + p.dead_time - 1
        n = p.order
        stage = np.zeros((n, n))
        stage[0, 0] = pv_weight
        scaled = op_weight * p.scale**2
        terminal = solve_riccati(p.A, p.B, stage, scaled)
        free = np.empty((samples, n))
        forced = np.zeros((samples, samples))
        state_map = np.eye(n)
        input_map = np.zeros((n, samples))
        hessian = np.zeros((samples, samples))
        linear = np.zeros((samples, n))
        for i in range(samples):
            input_map[:, i] = p.B
            free[i], forced[i] = state_map[0], input_map[0]
            weight = terminal if i == samples - 1 else stage
            hessian += input_map.T @ weight @ input_map
            linear += input_map.T @ weight @ state_map
            if i < samples - 1:
                state_map = p.A @ state_map
                input_map = p.A @ input_map
        return cls(0.5 * (hessian + hessian.T), linear, free, forced, scaled)

    @property
    def samples(self) -> int:
        """Length of the horizon, dead time included."""
        return int(self.linear.shape[0])
