"""The simulation-error criterion: the whole window simulated from OP alone."""

from __future__ import annotations

import math

import numpy as np

from estimator._kernels import Array, stems
from estimator.conversion import process_description, process_model
from estimator.estimate import Estimate
from estimator.noise import effective_samples
from estimator.posterior import Likelihood, Posterior, explore
from estimator.regression import Regression
from estimator.result import RunnerUp
from estimator.search import MIN_MOVES, Candidate, shortened
from estimator.window import Window

__all__ = ["oe_estimate"]

_LAG_REACH = 4


def oe_estimate(
    window: Window,
    regression: Regression,
    found: tuple[Candidate, ...],
    confidence: float,
    bic: float,
) -> Estimate:
    """Estimate valve and process from the candidates of the search, best first, at least one.

    ``bic`` is that of the whitened errors, to compare with another criterion.
    """
    best = shortened(window.u, regression, found[0])
    fit = regression.solve(best.stem(window.u), best.structure, best.dead_time)
    samples = effective_samples(fit.residual, regression.weight)
    posterior = _posterior(window.u, regression, best, samples)
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
        stem=best.stem(window.u),
        simulated=fit.prediction,
        process=process_description(window, best.structure, model, gain),
        model=model,
        bic=bic,
        posterior=posterior,
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


def _posterior(u: Array, regression: Regression, best: Candidate, samples: float) -> Posterior:
    """Likelihood with the linear part and the dead time at their best, the poles held."""
    lags = tuple(
        d
        for d in range(best.dead_time - _LAG_REACH, best.dead_time + _LAG_REACH + 1)
        if 0 <= d <= regression.max_lag
    )

    def evaluate(band: Array, jump: Array, first: Array) -> tuple[Array, Array]:
        stem, moves = stems(u, band, jump, u[0] + first)
        cost, gain = regression.costs_and_gains(stem, best.structure, lags)
        pick = cost.argmin(axis=0)
        index = np.arange(band.size)
        log_likelihood = -0.5 * samples * np.log(cost[pick, index])
        log_likelihood[moves < MIN_MOVES] = -np.inf
        return log_likelihood, gain[pick, index]

    anchored = best.anchored(u)
    return explore(Likelihood(evaluate, anchored.side), anchored)
