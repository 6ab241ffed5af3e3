"""The nonlinear programme (11) on the smoothed valve, for IPOPT through CasADi.

Single shooting: the stem of all samples is a function of ``(fS, fD)`` and of the stem before the
first sample, theta enters linearly, so there are few unknowns and the exact Hessian is cheap. The
window's data are parameters of the programme; one compiled solver serves every window of a length.

CasADi is optional: ``pip install "fieldlink[nlp]"``.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.outcomes import EstimatorError
from estimator.published.paper_fit import ArxStructure

__all__ = ["Programme", "Solution", "SolverOutcome", "require_casadi"]

Array = NDArray[np.float64]


class SolverOutcome(StrEnum):
    """How IPOPT ended."""

    SOLVED = "solved"
    ITERATION_LIMIT = "iteration_limit"
    INFEASIBLE = "infeasible"
    FAILED = "failed"

    @property
    def advice(self) -> str:
        """What it means for the point that came with it."""
        return {
            SolverOutcome.SOLVED: "A stationary point: the local minimum next to this start.",
            SolverOutcome.ITERATION_LIMIT: "Not converged; more iterations or scaling may help.",
            SolverOutcome.INFEASIBLE: "The stem hardly moves there; start elsewhere.",
            SolverOutcome.FAILED: "The numbers ran away; scale the window or start elsewhere.",
        }[self]


_OUTCOMES = {
    "Solve_Succeeded": SolverOutcome.SOLVED,
    "Solved_To_Acceptable_Level": SolverOutcome.SOLVED,
    "Maximum_Iterations_Exceeded": SolverOutcome.ITERATION_LIMIT,
    "Infeasible_Problem_Detected": SolverOutcome.INFEASIBLE,
}


@dataclass(frozen=True, slots=True)
class Solution:
    """Where IPOPT ended: frictions, stem before the first sample, theta, and how it got there."""

    static_friction: float
    dynamic_friction: float
    stem0: float
    theta: Array
    outcome: SolverOutcome
    iterations: int

    @property
    def is_finite(self) -> bool:
        """Whether the point can be evaluated at all."""
        frictions = (self.static_friction, self.dynamic_friction, self.stem0)
        return bool(np.isfinite(frictions).all() and np.isfinite(self.theta).all())


def require_casadi() -> ModuleType:
    """CasADi, or an error that says how to get it."""
    try:
        import casadi
    except ImportError as error:
        raise EstimatorError(
            "the paper's optimisation needs CasADi, which is not installed: "
            'pip install "fieldlink[nlp]", or use the default search, which needs nothing'
        ) from error
    module: ModuleType = casadi
    return module


@lru_cache(maxsize=8)
def _solver(samples: int, structure: ArxStructure, max_iterations: int, warm: bool) -> Any:
    """IPOPT for windows of one length; unknowns ``[fS, fD, x0, theta]``.

    Parameters: OP, PV, tau. Constraints: ``fS - fD``, the stem's variance, ``x0`` from the first
    OP within ``fS`` on either side.
    """
    ca = require_casadi()
    op, pv, tau = ca.SX.sym("op", samples), ca.SX.sym("pv", samples), ca.SX.sym("tau")
    static, dynamic = ca.SX.sym("fS"), ca.SX.sym("fD")
    stem0, theta = ca.SX.sym("x0"), ca.SX.sym("theta", structure.coefficients)
    stem, stems = stem0, []
    for k in range(samples):
        error = op[k] - stem
        upper = ca.tanh(tau * (static - error))
        lower = ca.tanh(tau * (static + error))
        stay = 0.5 * (upper + lower)
        stem = stay * stem + (1.0 - stay) * op[k] + 0.5 * (upper - lower) * dynamic
        stems.append(stem)
    position = ca.vertcat(*stems)
    lead, delay = structure.lead, structure.dead_time
    columns = [-pv[lead - i : samples - i] for i in range(1, structure.na + 1)]
    columns += [position[lead - delay - i : samples - delay - i] for i in range(structure.nb)]
    if structure.intercept:
        columns.append(ca.SX.ones(samples - lead, 1))
    error = pv[lead:] - ca.mtimes(ca.horzcat(*columns), theta)
    variance = ca.sumsqr(position - ca.sum1(position) / samples) / samples
    programme = {
        "x": ca.vertcat(static, dynamic, stem0, theta),
        "p": ca.vertcat(op, pv, tau),
        "f": 0.5 * ca.sumsqr(error),
        "g": ca.vertcat(
            static - dynamic, variance, static - (stem0 - op[0]), static + (stem0 - op[0])
        ),
    }
    options = {
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.max_iter": max_iterations,
        "print_time": False,
        "error_on_fail": False,
        "show_eval_warnings": False,
    }
    if warm:
        # The default barrier first pulls a start to the middle of its bounds, out of its basin.
        options |= {"ipopt.mu_init": 1e-5, "ipopt.bound_push": 1e-6, "ipopt.bound_frac": 1e-6}
    return ca.nlpsol("stiction", "ipopt", programme, options)


@dataclass(frozen=True, slots=True)
class Programme:
    """Problem (11) for one window.

    Attributes:
        op, pv: samples, shape ``(n,)``, scaled or not.
        structure: ARX orders.
        alpha: of the variance constraint (11b).
        max_iterations: bound of IPOPT.
        warm: keep near the start instead of beginning from the middle of the bounds.
    """

    op: Array
    pv: Array
    structure: ArxStructure
    alpha: float = 0.1
    max_iterations: int = 200
    warm: bool = False

    def solve(
        self,
        static: float,
        dynamic: float,
        stem0: float,
        theta: Array,
        *,
        tau: float,
        free_stem0: bool,
        reach: float = np.inf,
    ) -> Solution:
        """Run IPOPT from one point.

        ``free_stem0`` makes the first position an unknown too; ``reach`` keeps both frictions
        within so much of the start.
        """
        solver = _solver(self.op.size, self.structure, self.max_iterations, self.warm)
        span = float(np.ptp(self.op))
        unknown_theta = np.full(theta.size, np.inf)
        away = np.inf if free_stem0 else 0.0
        # A start outside the triangle of (11b) begins on its edge.
        start = np.clip([static, dynamic], 0.0, span)
        tied = 0.0 if free_stem0 else -np.inf
        answer = solver(
            x0=np.concatenate([start, [stem0], theta]),
            p=np.concatenate([self.op, self.pv, [tau]]),
            lbx=np.concatenate([np.maximum(0.0, start - reach), [stem0 - away], -unknown_theta]),
            ubx=np.concatenate([np.minimum(span, start + reach), [stem0 + away], unknown_theta]),
            lbg=np.array([0.0, self.alpha * float(self.op.var()), tied, tied]),
            ubg=np.full(4, np.inf),
        )
        statistics = solver.stats()
        point = np.asarray(answer["x"], dtype=np.float64).ravel()
        return Solution(
            static_friction=float(point[0]),
            dynamic_friction=float(point[1]),
            stem0=float(point[2]),
            theta=point[3:],
            outcome=_OUTCOMES.get(statistics["return_status"], SolverOutcome.FAILED),
            iterations=int(statistics["iter_count"]),
        )
