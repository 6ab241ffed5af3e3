"""The rows of a window under a longer noise model than the verdict's.

A load that drifts behind a slow process, with noise of the transmitter beside it, is noise of a
high order. In closed loop a model that is too short for it biases the process, and a valve that
sticks a little can stand for what the noise model lacks (Ljung 1999, section 13.4), and so can a
curved characteristic: OP follows the load's drift, and any curve of it is one more drift.
"""

from __future__ import annotations

from dataclasses import replace

from estimator.diagnosis.advice_settings import Advising
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.search.processes import polish, settle

__all__ = ["under_long_noise", "with_long_noise"]


def with_long_noise(case: Case, settings: Advising) -> Case:
    """The case with the long noise model, and past enough for it; shorter in a short window."""
    rows = case.rows
    wanted = case.settings.modelling.max_dead_time + settings.noise_order + 2
    first = max(rows.first, min(wanted, rows.size // 4))
    modelling = replace(
        case.settings.modelling,
        noise_orders=(min(settings.noise_order, first - 1),),
        max_reflection=settings.reflection,
    )
    weight = rows.weight.copy()
    weight[:first] = 0.0
    rows = replace(rows, weight=weight, first=first, count=float(weight.sum()))
    return Case(rows, replace(case.settings, modelling=modelling))


def under_long_noise(
    case: Case, one: Hypothesis, plain_case: Case, plain: Hypothesis, settings: Advising
) -> float:
    """Log Bayes factor of an explanation over a plain one, both fitted again under long noise.

    Each in its own case; nats, without prices that are not in the likelihoods.
    """
    long = with_long_noise(case, settings)
    plain_long = with_long_noise(plain_case, settings)
    again = _fit(long, one, one)
    # the plain one from its own process and from the other's: the better one counts
    rival = max(_fit(plain_long, plain, start).likelihood for start in (plain, again))
    return float(again.likelihood - rival)


def _fit(case: Case, of: Hypothesis, start: Hypothesis) -> Hypothesis:
    return settle(
        case, polish(case, of.valve, start, of.nuisances, start.taps, passes=3, wide=True)
    )
