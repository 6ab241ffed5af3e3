"""The one-step-ahead criterion's estimate: valve, orders, coefficients, intervals."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from estimator._kernels import Array
from estimator._one_step import one_step_costs
from estimator._slips import Op
from estimator.arx import ArxFit, ArxOrders
from estimator.arx_search import ArxFound
from estimator.candidate import stem_of
from estimator.estimate import Estimate
from estimator.posterior import explore
from estimator.result import Interval, Process, RunnerUp
from estimator.window import Window
from loop_model import ProcessModel

__all__ = ["arx_estimate"]

_RUNNERS_UP = 4


def arx_estimate(window: Window, op: Op, found: ArxFound, confidence: float) -> Estimate:
    """Valve and ARX process of what the search found, with intervals."""
    best, regression, ranked = found.best.anchored(op), found.regression, found.ranked

    def evaluate(nodes: Array) -> tuple[Array, Array]:
        cost, gain = one_step_costs(op, regression.tables, nodes, best.first)
        return -0.5 * regression.count * np.log(cost), gain

    posterior = explore(evaluate, best)
    band, jump, lead = (float(v) for v in posterior.best)
    stem = stem_of(op, band, jump, lead, best.first)
    fit = regression.solve(stem)
    intervals = Estimate.intervals(posterior, confidence, op.u)
    deviation = regression.gain_deviation(fit, stem)
    gain = posterior.interval(posterior.gain, confidence, deviation).around(
        float(fit.b.sum()) / (1.0 + float(fit.a.sum()))
    )
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
        runners_up=tuple(
            RunnerUp(orders.name, orders.dead_time, orders.bic - chosen.bic)
            for orders in ranked[1 : 1 + _RUNNERS_UP]
        ),
    )


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
