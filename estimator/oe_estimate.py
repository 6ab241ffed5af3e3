"""The simulation-error criterion: the whole window simulated from OP alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.special import ndtri

from estimator._kernels import Array
from estimator._response import least_squares
from estimator._simulated import simulated_costs
from estimator._slips import Op, step_of
from estimator.arx import ArxRegression, select_orders
from estimator.candidate import Candidate
from estimator.conversion import process_description, process_model
from estimator.estimate import MISFIT, Estimate
from estimator.noise import effective_samples, errs_at_slips
from estimator.posterior import Posterior
from estimator.regression import Regression, delayed
from estimator.result import Interval, RunnerUp
from estimator.search import follows, process_search
from estimator.structures import Structure
from estimator.whitened import noise_left
from estimator.window import Window
from estimator.zoomed import FINE, HARDLY, ROUGH, Nodes, explore

__all__ = ["oe_estimate", "simulable"]

_LAG_REACH = 4
_ROUNDS, _ORDER = 3, 10
_NUDGE = 0.01
_BLUR = 0.1
"""A real valve slips between two samples: share of OP's step per sample."""
_LOW_ORDER = 0.025
"""Standard deviation of S and J, as a share of S, that a process of low order leaves."""
_RIVALS, _RIVAL, _APART = 2, 4.0, 0.02
"""Other optima whose likelihood counts: how many, how far below, how far apart in S."""


def oe_estimate(
    window: Window,
    op: Op,
    regression: Regression,
    found: tuple[Candidate, ...],
    confidence: float,
    bic: float,
    *,
    sticky: bool,
) -> Estimate:
    """Estimate valve and process from the candidates of the search, best first, at least one.

    ``bic`` is that of the whitened errors, to compare with another criterion. Where the window was
    not found ``sticky``, a rough look at the valve that hardly sticks is enough.
    """
    rivals = found[1:] if sticky else ()
    start = found[0]
    nodes = FINE if sticky else HARDLY if follows(op, start) else ROUGH
    samples = _samples(op, regression, start)
    posterior, best = _posterior(op, regression, start, rivals, samples, nodes)
    stem = best.stem(op)
    fit = regression.solve(stem, best.structure, best.dead_time)
    late, errors = _BLUR * step_of(op.u), _model_error(window, stem)
    blur = math.hypot(late, best.band * errors[0]), math.hypot(late, best.band * errors[1])
    band, jump, static, dynamic = Estimate.intervals(
        posterior, confidence, blur, best.band, best.jump
    )
    information = _information(regression, stem, best.structure, best.dead_time)
    deviation = _gain_deviation(best.cost, samples, information)
    gain = posterior.gain_interval(confidence, deviation).around(fit.gain)
    model = process_model(window, best.structure, best.dead_time, fit)
    return Estimate(
        criterion="oe",
        band=band,
        jump=jump,
        static=static,
        dynamic=dynamic,
        stem=stem,
        simulated=fit.prediction,
        process=process_description(window, best.structure, model, gain),
        model=model,
        bic=bic,
        peaks=posterior.peaks(),
        simulating=best,
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


def simulable(
    window: Window, regression: Regression, estimate: Estimate, confidence: float
) -> Estimate:
    """The estimate with a low-order process that simulates PV from its stem.

    For one-step-ahead coefficients that are unstable: an integrator or a slow disturbance puts a
    pole a little beyond the unit circle, and no controller can predict with it. Process and noise
    are fitted in turn (generalised least squares): what the process leaves is mostly load, which a
    wrong process would simulate otherwise.
    """
    stem, used = estimate.stem, regression
    best = process_search(stem, used)
    for _ in range(_ROUNDS):
        taps, _ = noise_left(regression, used, stem, best, _ORDER)
        used = Regression(regression.y, regression.good, taps, 1)
        best = process_search(stem, used)
    fit = used.solve(stem, best.structure, best.dead_time)
    samples = effective_samples(fit.residual, used.weight)
    information = _information(used, stem, best.structure, best.dead_time)
    reach = ndtri(0.5 + 0.5 * confidence) * _gain_deviation(best.cost, samples, information)
    gain = Interval(fit.gain, fit.gain - reach, fit.gain + reach)
    model = process_model(window, best.structure, best.dead_time, fit)
    return replace(
        estimate,
        simulated=fit.prediction,
        process=process_description(window, best.structure, model, gain),
        model=model,
    )


def _gain_deviation(cost: float, samples: float, information: float) -> float:
    return math.sqrt(cost / samples / max(information, 1e-300))


def _information(regression: Regression, stem: Array, structure: Structure, lag: int) -> float:
    """Energy of the response that neither a shared column nor a change of a pole explains.

    The variance of the gain is the noise's divided by it (delta method, the poles free as well).
    """

    def response(one: Structure) -> Array:
        return delayed(one.response(stem), lag)

    own = response(structure)
    others = [structure.columns(regression.size), regression.extra]
    for name in ("slow", "fast"):
        pole = getattr(structure, name)
        if 0.0 < pole < 1.0:
            others.append(
                response(replace(structure, **{name: pole ** (1.0 + _NUDGE)}))[None] - own
            )
    _, left = least_squares(
        regression.weighted(np.vstack(others)), regression.weighted(own[None])[0]
    )
    return float(left @ left)


def _samples(op: Op, regression: Regression, best: Candidate) -> float:
    fit = regression.solve(best.stem(op), best.structure, best.dead_time)
    return effective_samples(fit.residual, regression.weight)


def _model_error(window: Window, stem: Array) -> tuple[float, float]:
    """Standard deviations of S and J as shares of S, beside what the likelihood says."""
    orders = select_orders(window.y, window.good, stem)[0]
    one_step = ArxRegression(window.y, window.good, orders)
    residual = one_step.solve(stem).residual
    errs = errs_at_slips(residual, one_step.weight, stem, orders.dead_time)
    return MISFIT if errs else (_LOW_ORDER, _LOW_ORDER)


def _posterior(
    op: Op,
    regression: Regression,
    best: Candidate,
    others: tuple[Candidate, ...],
    samples: float,
    nodes: Nodes,
) -> tuple[Posterior, Candidate]:
    """Likelihood around the best valve and around those that the search found nearly as likely.

    The candidate is the most likely one around the best valve.
    """

    def worth(candidate: Candidate) -> float:
        free = candidate.structure.free * math.log(samples)
        return -0.5 * (samples * math.log(candidate.cost) + free)

    found, refined = _around(op, regression, best, samples, nodes)
    seen = [best]
    for other in others:
        near = any(abs(other.band - one.band) < _APART * one.band for one in seen)
        if len(seen) > _RIVALS or near or not worth(other) > worth(best) - _RIVAL:
            continue
        seen.append(other)
        found = found.joined(_around(op, regression, other, samples, nodes)[0])
    return found, refined


def _around(
    op: Op, regression: Regression, best: Candidate, samples: float, nodes: Nodes
) -> tuple[Posterior, Candidate]:
    """Likelihood with the linear part and the dead time at their best, the poles held."""
    best = best.anchored(op)
    tables = regression.tables(best.structure)
    lag = max(0, best.dead_time - _LAG_REACH)
    lags = min(regression.max_lag, best.dead_time + _LAG_REACH) - lag + 1
    free = best.structure.free * math.log(samples)

    def evaluate(valves: Array) -> tuple[Array, Array]:
        cost, gain = simulated_costs(op, tables, valves, best.first, lag, lags)
        pick = cost.argmin(axis=0), np.arange(valves.shape[0])
        return -0.5 * (samples * np.log(cost[pick]) + free), gain[pick]

    posterior = explore(evaluate, best, nodes)
    top = posterior.best
    cost, _ = simulated_costs(op, tables, top[None].copy(), best.first, lag, lags)
    band, jump, lead = (float(v) for v in top)
    refined = replace(
        best,
        cost=float(cost.min()),
        band=band,
        jump=jump,
        lead=lead,
        dead_time=lag + int(cost.argmin()),
    )
    return posterior, refined
