"""The one-step-ahead criterion's estimate: valve, orders, coefficients, intervals."""

from __future__ import annotations

import math
from types import MappingProxyType

import numpy as np

from estimator._kernels import Array
from estimator._one_step import one_step_costs
from estimator._slips import Op, step_of
from estimator.arx import ArxFit, ArxOrders
from estimator.arx_search import ArxFound
from estimator.candidate import stem_of
from estimator.estimate import MISFIT, Estimate
from estimator.listed import cut_short, listed_posterior, reaching
from estimator.noise import errs_at_slips
from estimator.one_step_likelihood import OneStepLikelihood
from estimator.posterior import Posterior
from estimator.result import Interval, Process, RunnerUp
from estimator.window import Window
from estimator.zoomed import explore
from loop_model import ProcessModel

__all__ = ["arx_estimate", "arx_posterior"]

_RUNNERS_UP = 4
_BLUR = 0.005
"""S is told to this share of OP's step per sample: half of what sets of slips are told apart by."""


def arx_estimate(window: Window, op: Op, found: ArxFound, confidence: float) -> Estimate:
    """Valve and ARX process of what the search found, with intervals."""
    best, regression = found.best.anchored(op), found.regression
    posterior = arx_posterior(window, op, found)
    band, jump, lead = (float(v) for v in posterior.best)
    stem = stem_of(op, band, jump, lead, best.first)
    ranked = found.ranked
    fit = regression.solve(stem)
    errs = errs_at_slips(fit.residual, regression.weight, stem, regression.orders.dead_time)
    step, misfit = step_of(op.u), MISFIT if errs else (0.0, 0.0)
    blur = math.hypot(_BLUR * step, misfit[0] * band), misfit[1] * band
    intervals = Estimate.intervals(posterior, confidence, blur, band, jump)
    deviation = regression.gain_deviation(fit, stem)
    gain = posterior.gain_interval(confidence, deviation).around(fit.gain)
    model = fit.process(window, regression.orders.dead_time)
    chosen = ranked[0]
    return Estimate(
        criterion="arx",
        band=intervals[0],
        jump=intervals[1],
        static=intervals[2],
        dynamic=intervals[3],
        stem=stem,
        simulated=_simulated(window, fit, stem, regression.orders),
        process=_description(window, model, regression.orders, gain),
        model=model,
        bic=found.bic,
        peaks=posterior.peaks(),
        runners_up=tuple(
            RunnerUp(orders.name, orders.dead_time, orders.bic - chosen.bic)
            for orders in ranked[1 : 1 + _RUNNERS_UP]
        ),
    )


def arx_posterior(window: Window, op: Op, found: ArxFound) -> Posterior:
    """How probable valves are around the one that the search found, in shares of OP's span."""
    best = found.best.anchored(op)
    likelihood = OneStepLikelihood(
        window.y, window.good, found.regression.orders, found.best.cost / found.regression.count
    )
    # what the search has listed will do, unless its refinement went on to another valve
    listed = None
    if found.posterior is not None and not cut_short(found.posterior, found.middle, best.band):
        listed = reaching(op, likelihood, best, found.posterior)
    if listed is None:
        listed = listed_posterior(op, likelihood, best)
    if listed is not None:
        return listed
    n = op.u.size

    def evaluate(nodes: Array) -> tuple[Array, Array]:
        cost, gain = one_step_costs(op, likelihood.tables(n), nodes, best.first)
        return likelihood.log(n, cost), gain

    return explore(evaluate, best)


def _simulated(window: Window, fit: ArxFit, stem: Array, orders: ArxOrders) -> Array:
    """PV simulated from the stem, started from PV's first samples and levelled on the window.

    The intercept is a nuisance of one-step prediction: simulated, its small error is an offset.
    """
    poles = np.abs(np.roots(np.concatenate([[1.0], fit.a])))
    if poles.size and float(poles.max()) > 1.0 + 1e-6:
        return np.full(window.size, np.nan)
    simulated = fit.simulate(stem, np.full(orders.na, window.y[0]), orders.dead_time)
    offset = float((window.y - simulated)[window.good].mean())
    return simulated + offset


def _description(window: Window, model: ProcessModel, orders: ArxOrders, gain: Interval) -> Process:
    parameters = {f"a{i}": value for i, value in enumerate(model.a, start=1)}
    parameters |= {f"b{i}": value for i, value in enumerate(model.b, start=1)}
    parameters["offset"] = model.offset
    parameters["dead_time"] = model.dead_time * window.period
    return Process(
        orders.name,
        MappingProxyType(parameters),
        model.dead_time,
        gain.scaled(window.pv_scale / window.op_span),
    )
