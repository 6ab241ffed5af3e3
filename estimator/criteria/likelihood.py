"""The estimate under the likelihood: ``auto`` (any noise) and ``oe`` (white noise) alike."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.special import ndtri

from estimator.algebra import dot
from estimator.arrays import Array
from estimator.criteria.conversion import describe_process, process_model
from estimator.estimate import Estimate
from estimator.evidence.weighing import Weighing
from estimator.hypotheses.gain import gain_variance, straightened
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.linear_fit import LinearFit, fit_linear
from estimator.hypotheses.noise import WHITE
from estimator.intervals.posterior import Posterior, sample_posterior
from estimator.intervals.varying import gain_shares, posterior_of_slips
from estimator.processes.poles import INTEGRATOR
from estimator.result import Interval
from estimator.window import Window

__all__ = ["likelihood_estimate", "simulate"]


def simulate(case: Case, of: Hypothesis) -> tuple[Array, float]:
    """Scaled PV ``(n,)`` simulated from the stem, and the share of PV's variance it explains.

    Gain and columns by plain least squares: simulation errors are what a reader compares.
    """
    fit = _white_fit(case, of)
    error = fit.residual * case.rows.weight
    judged = case.rows.y[case.rows.weight > 0.0]
    total = float(np.square(judged - judged.mean()).sum())
    return case.rows.y - fit.residual, 1.0 - float(dot(error, error)) / total


def _white_fit(case: Case, of: Hypothesis) -> LinearFit:
    columns = case.columns(of.nuisances, of.stem, of.poles, of.dead_time)
    return fit_linear(case.rows, of.poles.response(of.stem), of.dead_time, columns, WHITE)


def likelihood_estimate(
    case: Case,
    window: Window,
    weighing: Weighing,
    confidence: float,
    criterion: str,
    reason: str,
) -> Estimate:
    """Valve, process and intervals of the sticky valve that explains most."""
    best, varying = weighing.best, weighing.varying
    assert best.valve is not None
    straight = straightened(case, best)
    if varying is None:
        posterior = sample_posterior(case, weighing.laws)
        gains, varies = _likely_gains(case, straight, posterior), 0.0
    else:
        posterior = posterior_of_slips(case, varying)
        gains, varies = straight.gain * gain_shares(varying, posterior), varying.deviation
    valve = best.valve

    def interval(of_band: float, of_jump: float) -> Interval:
        value = of_band * valve.band + of_jump * valve.jump
        return posterior.interval(of_band, of_jump, confidence).within(0.0).around(value)

    columns = case.columns(straight.nuisances, best.stem, best.poles, best.dead_time)
    fit = fit_linear(case.rows, best.poles.response(best.stem), best.dead_time, columns, best.taps)
    steep = window.pv_scale / window.op_span
    model = process_model(window, best.poles, best.dead_time, fit, float(best.stem[0]))
    gain = _gain_interval(case, straight, gains, confidence)
    unit = steep * (INTEGRATOR / window.period if best.poles.integrating else 1.0)
    return Estimate(
        criterion=criterion,
        reason=reason,
        band=interval(1.0, 0.0),
        jump=interval(0.0, 1.0),
        static=interval(0.5, 0.5),
        dynamic=interval(0.5, -0.5),
        stem=best.stem,
        simulated=simulate(case, best)[0],
        process=describe_process(window, best.poles, model, gain.scaled(unit)),
        model=model,
        peaks=posterior.peaks(),
        varies=varies,
    )


def _likely_gains(case: Case, best: Hypothesis, posterior: Posterior) -> Array:
    """The scaled gain beside each of some likely valves of a law."""
    assert best.valve is not None
    # samples drawn evenly from the posterior: each stands for as much probability as the others
    count = case.settings.spreading.gains
    share = np.cumsum(posterior.weights)
    drawn = np.searchsorted(share, (np.arange(count) + 0.5) / count * share[-1])
    gains = []
    for band, jump, start in posterior.samples[drawn].tolist():
        valve = replace(best.valve, band=band, jump=jump, start=start)
        found = case.fit(
            valve, best.poles, best.dead_time, best.nuisances, best.taps, refit_noise=False
        )
        gains.append(found.gain)
    return np.array(gains)


def _gain_interval(case: Case, best: Hypothesis, gains: Array, confidence: float) -> Interval:
    """The scaled gain: its spread over likely valves, and the noise's for each valve."""
    between = float(np.square(gains - best.gain).mean())
    noise = gain_variance(case, best)
    if not math.isfinite(noise):
        return Interval(best.gain, -math.inf, math.inf)
    reach = float(ndtri(0.5 + 0.5 * confidence)) * math.sqrt(between + noise)
    return Interval(best.gain, best.gain - reach, best.gain + reach)
