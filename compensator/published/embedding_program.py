"""The nonlinear program of the stiction-embedding MPC, in CasADi for IPOPT."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensator.action import CompensatorError
from compensator.conventional.condensed import CondensedCost
from compensator.published.embedding_settings import EmbeddingSettings
from loop_model import ValveModel

__all__ = ["EmbeddingProgram", "Problem"]

Array = NDArray[np.float64]

_CONVERGED = frozenset({"Solve_Succeeded", "Solved_To_Acceptable_Level"})


@dataclass(frozen=True, eq=False)
class Problem:
    """What changes from scan to scan.

    Attributes:
        stem, op: where they are.
        target: position of the stem.
        linear: linear term of PV's cost, shape ``(horizon,)``.
        factor: of its quadratic term.
    """

    stem: float
    op: float
    target: float
    linear: Array
    factor: float


def _casadi() -> Any:
    try:
        import casadi
    except ImportError as error:
        raise CompensatorError(
            "the embedding controller needs CasADi with IPOPT, which is not installed; run "
            'pip install "fieldlink[nlp]", or use the hybrid controller, which needs nothing'
        ) from error
    return casadi


class EmbeddingProgram:
    """The problem of one loop: set up once, solved and priced each scan.

    Args:
        cost: of PV and of OP over the horizon.
        settings: weights and bounds.
        move_weight: price of the squared change of OP, in PV squared.

    Attributes:
        iterations: of IPOPT since it was set to 0.

    Raises:
        CompensatorError: CasADi is absent.
    """

    def __init__(
        self, cost: CondensedCost, settings: EmbeddingSettings, move_weight: float
    ) -> None:
        self._casadi = _casadi()
        self._cost, self._settings, self._move_weight = cost, settings, move_weight
        self._solver = self._build()
        self.iterations = 0

    def price(self, problem: Problem, valve: ValveModel, op: Array) -> float:
        """Return the cost of an OP trajectory with the exact valve, but for the part that is the
        same for all trajectories.
        """
        stem = valve.simulate(op, problem.stem)
        z = stem - problem.target
        moves = np.diff(op, prepend=problem.op)
        return float(
            problem.factor * (z @ self._cost.hessian @ z)
            + 2.0 * z @ problem.linear
            + self._cost.op_weight * np.sum((op - problem.target) ** 2)
            + self._move_weight * np.sum(moves**2)
        )

    def _build(self) -> Any:
        """Set up IPOPT once; start, target and linear term are parameters."""
        ca, s, n = self._casadi, self._settings, self._cost.samples
        u, x = ca.SX.sym("u", n), ca.SX.sym("x", n)
        stem0, op0, target = ca.SX.sym("stem0"), ca.SX.sym("op0"), ca.SX.sym("target")
        linear, factor = ca.SX.sym("linear", n), ca.SX.sym("factor")
        z = x - target
        before, previous = ca.vertcat(stem0, x[:-1]), ca.vertcat(op0, u[:-1])
        cost = factor * ca.bilin(ca.SX(ca.DM(self._cost.hessian)), z, z) + 2.0 * ca.dot(linear, z)
        cost += self._cost.op_weight * ca.sumsqr(u - target)
        cost += self._move_weight * ca.sumsqr(u - previous)
        frictions = ca.SX.sym("frictions", 2)
        rows = [x - _smoothed(ca, frictions, s.tau, before, u)]
        rated = math.isfinite(s.limits.rate)
        if rated:
            rows.append(u - previous)
        self._row_low = np.zeros(n * len(rows))
        self._row_high = np.zeros(n * len(rows))
        if rated:
            self._row_low[n:], self._row_high[n:] = -s.limits.rate, s.limits.rate
        # A small first barrier keeps IPOPT at its warm start, which is what it is given for.
        options = {
            "print_time": False,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.max_iter": s.max_iterations,
            "ipopt.max_wall_time": s.max_seconds,
            "ipopt.warm_start_init_point": "yes",
            "ipopt.mu_init": 1e-4,
            "ipopt.tol": 1e-6,
        }
        problem = {
            "x": ca.vertcat(u, x),
            "p": ca.vertcat(stem0, op0, target, factor, frictions, linear),
            "f": cost,
            "g": ca.vertcat(*rows),
        }
        return ca.nlpsol("embedding", "ipopt", problem, options)

    def solve(self, problem: Problem, valve: ValveModel, start: Array) -> Array | None:
        """Return OP over the horizon, solved from one warm start; None unless IPOPT says that it
        converged.
        """
        limits, n = self._settings.limits, self._cost.samples
        stem = valve.simulate(start, problem.stem)
        known = [problem.stem, problem.op, problem.target, problem.factor]
        frictions = [valve.static_friction, valve.dynamic_friction]
        low = np.concatenate([np.full(n, limits.low), np.full(n, -np.inf)])
        high = np.concatenate([np.full(n, limits.high), np.full(n, np.inf)])
        result = self._solver(
            x0=np.concatenate([start, stem]),
            p=np.concatenate([known, frictions, problem.linear]),
            lbx=low,
            ubx=high,
            lbg=self._row_low,
            ubg=self._row_high,
        )
        stats = self._solver.stats()
        self.iterations += int(stats["iter_count"])
        if stats["return_status"] not in _CONVERGED:
            return None
        return np.array(result["x"], dtype=np.float64).ravel()[:n]


def _smoothed(casadi: Any, frictions: Any, tau: float, stem: Any, op: Any) -> Any:
    """Return (5) with (6), as CasADi expressions of the stem before and of OP."""
    fs, fd = frictions[0], frictions[1]
    error = op - stem
    above, below = casadi.tanh(tau * (error + fs)), casadi.tanh(tau * (fs - error))
    eta1, eta2 = 0.5 * (above + below), 0.5 * (below - above)
    return eta1 * stem + (1.0 - eta1) * op + eta2 * fd
