"""The rows of a window under a longer noise model than the verdict's.

A load that drifts behind a slow process, with noise of the transmitter beside it, is noise of a
high order. In closed loop a model that is too short for it biases the process, and a valve that
sticks a little can stand for what the noise model lacks (Ljung 1999, section 13.4).
"""

from __future__ import annotations

from dataclasses import replace

from estimator.diagnosis.advice_settings import Advising
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.search.processes import polish, settle

__all__ = ["valve_under_long_noise", "with_long_noise"]


def with_long_noise(case: Case, settings: Advising) -> Case:
    """The case with the long noise model, and past enough for it."""
    modelling = replace(
        case.settings.modelling,
        noise_orders=(settings.noise_order,),
        max_reflection=settings.reflection,
    )
    rows = case.rows
    first = min(modelling.max_dead_time + settings.noise_order + 2, rows.size // 4)
    weight = rows.weight.copy()
    weight[:first] = 0.0
    rows = replace(rows, weight=weight, first=max(first, rows.first), count=float(weight.sum()))
    return Case(rows, replace(case.settings, modelling=modelling))


def valve_under_long_noise(
    case: Case, sticky: Hypothesis, plain: Hypothesis, settings: Advising
) -> float:
    """Log Bayes factor of a valve over a healthy one, both fitted again under long noise; nats."""
    long = with_long_noise(case, settings)

    def fit(of: Hypothesis, start: Hypothesis) -> Hypothesis:
        return settle(
            long,
            polish(long, of.valve, start, of.nuisances, start.taps, passes=3, wide=True),
        )

    again = fit(sticky, sticky)
    # the healthy valve from its own process and from the other's: the better one counts
    healthy = max(fit(plain, start).likelihood for start in (plain, again))
    return float(again.likelihood - healthy)
