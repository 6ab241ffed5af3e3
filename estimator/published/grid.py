"""The paper's grid search: every node of a triangle of (fS, fD), least squares at each.

It is here as the baseline that the search of `identify` is measured against, in plain NumPy: the
valves of one row of the triangle are simulated side by side, theta is solved node by node.

Source: Bacci di Capaci et al. (2018), section 4; Bacci di Capaci, Scali and Pannocchia (2016).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimator.outcomes import EstimatorError
from estimator.published.paper_fit import ArxStructure, ArxWindow, InitialStem, PaperFit
from estimator.valves import HeValve, SlipStickValve, SmoothedValve

__all__ = ["grid_search"]

Array = NDArray[np.float64]


def _row_of_stems(
    op: Array, stem0: float, static: float, dynamic: Array, tau: float | None
) -> Array:
    """Stems of valves that share fS, shape ``(len(dynamic), n)``: (5)-(6), or (4) without tau."""
    stem = np.full(dynamic.size, stem0)
    out = np.empty((dynamic.size, op.size))
    for k, value in enumerate(op):
        error = value - stem
        if tau is None:
            moved = np.abs(error) > static
            stem = np.where(moved, value - np.sign(error) * dynamic, stem)
        else:
            upper = np.tanh(tau * (static - error))
            lower = np.tanh(tau * (static + error))
            stay = 0.5 * (upper + lower)
            stem = stay * stem + (1.0 - stay) * value + 0.5 * (upper - lower) * dynamic
        out[:, k] = stem
    return out


def grid_search(
    op: ArrayLike,
    pv: ArrayLike,
    *,
    na: int,
    nb: int,
    dead_time: int = 1,
    step: float,
    initial: str | InitialStem = InitialStem.FIRST,
    tau: float | None = 1e4,
    alpha: float = 0.1,
    intercept: bool = True,
    period: float = 1.0,
) -> PaperFit:
    """Search all ``(fS, fD)`` on a grid for the lowest one-step-ahead error (12).

    Args:
        op, pv: samples, shape ``(n,)``, finite, in their own units.
        na, nb, dead_time, intercept: see `ArxStructure`.
        step: of both frictions, in units of OP (the paper: 0.5 and 0.1).
        initial: ``"first"`` or ``"mean"``, the stem before the first sample.
        tau: sharpness of the smoothed valve; None for He's own.
        alpha: least variance of the stem over that of OP, the constraint of (11b).
        period: seconds between samples, passed on to the process.

    Returns:
        The best node; ``evaluations`` counts the least-squares problems solved.

    Raises:
        EstimatorError: unusable window, or a step that is not positive.
    """
    window = ArxWindow.of(
        op, pv, ArxStructure(na, nb, dead_time, intercept=intercept), period=period
    )
    if not 0.0 < step < np.inf:
        raise EstimatorError(f"step must be positive (units of OP, the paper: 0.5); got {step!r}")
    stem0 = InitialStem(initial).position(window.op)
    least_variance = alpha * float(window.op.var())
    best_cost, best_static, best_dynamic, evaluations = np.inf, 0.0, 0.0, 0
    for i in range(int(window.span / step) + 1):
        static = i * step
        dynamic = step * np.arange(i + 1, dtype=np.float64)
        stems = _row_of_stems(window.op, stem0, static, dynamic, tau)
        allowed = np.flatnonzero(stems.var(axis=1) >= least_variance)
        for j in allowed:
            cost = window.solve(stems[j])[1]
            if cost < best_cost:
                best_cost, best_static, best_dynamic = cost, static, float(dynamic[j])
        evaluations += int(allowed.size)
    if evaluations == 0:
        raise EstimatorError(
            f"no node keeps the stem's variance at {alpha} of OP's; lower alpha (the paper: 0.1)"
        )
    pair = HeValve.from_friction(best_static, best_dynamic)
    valve: SlipStickValve = (
        pair if tau is None else SmoothedValve(pair.stick_band, pair.slip_jump, tau=tau)
    )
    return window.fit(valve, stem0, evaluations=evaluations)
