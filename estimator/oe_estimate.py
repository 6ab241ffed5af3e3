"""The simulation-error criterion: the whole window simulated from OP alone."""

from __future__ import annotations

import math

import numpy as np

from estimator._kernels import Array
from estimator._simulated import simulated_costs
from estimator._slips import Op
from estimator.candidate import Candidate
from estimator.conversion import process_description, process_model
from estimator.estimate import Estimate
from estimator.noise import effective_samples
from estimator.posterior import Posterior, explore
from estimator.regression import Regression
from estimator.result import RunnerUp
from estimator.search import shortened
from estimator.window import Window

__all__ = ["oe_estimate"]

_LAG_REACH = 4


def oe_estimate(
    window: Window,
    op: Op,
    regression: Regression,
    found: tuple[Candidate, ...],
    confidence: float,
    bic: float,
) -> Estimate:
    """Estimate valve and process from the candidates of the search, best first, at least one.

    ``bic`` is that of the whitened errors, to compare with another criterion.
    """
    best = shortened(op, regression, found[0])
    fit = regression.solve(best.stem(op), best.structure, best.dead_time)
    samples = effective_samples(fit.residual, regression.weight)
    posterior = _posterior(op, regression, best, samples)
    band, jump, static, dynamic = Estimate.intervals(posterior, confidence, window.u)
    deviation = math.sqrt(best.cost / samples / max(fit.information, 1e-300))
    gain = posterior.interval(posterior.gain, confidence, deviation).around(fit.gain)
    model = process_model(window, best.structure, best.dead_time, fit)
    return Estimate(
        criterion="oe",
        band=band,
        jump=jump,
        static=static,
        dynamic=dynamic,
        stem=best.stem(op),
        simulated=fit.prediction,
        process=process_description(window, best.structure, model, gain),
        model=model,
        bic=bic,
        runners_up=tuple(
            RunnerUp(
                other.structure.name,
                other.dead_time,
                samples * math.log(other.cost / best.cost)
                + (other.structure.free - best.structure.free) * math.log(samples),
            )
            for other in found[1:]
        ),
    )


def _posterior(op: Op, regression: Regression, best: Candidate, samples: float) -> Posterior:
    """Likelihood with the linear part and the dead time at their best, the poles held."""
    best = best.anchored(op)
    tables = regression.tables(best.structure)
    lag = max(0, best.dead_time - _LAG_REACH)
    lags = min(regression.max_lag, best.dead_time + _LAG_REACH) - lag + 1

    def evaluate(nodes: Array) -> tuple[Array, Array]:
        cost, gain = simulated_costs(op, tables, nodes, best.first, lag, lags)
        pick = cost.argmin(axis=0), np.arange(nodes.shape[0])
        return -0.5 * samples * np.log(cost[pick]), gain[pick]

    return explore(evaluate, best)
