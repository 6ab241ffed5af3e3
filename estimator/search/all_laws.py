"""The likeliest valve of every law of friction."""

from __future__ import annotations

from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.search.descent import refine_valve
from estimator.valves.laws import LAWS, NEEDS

__all__ = ["refine_all_laws"]


def refine_all_laws(case: Case, sticky: Hypothesis) -> tuple[Hypothesis, ...]:
    """The likeliest valve of every law, the likeliest of all first: for the estimate."""
    assert sticky.valve is not None
    found = {sticky.valve.law: sticky}
    for law in LAWS:
        start = found[NEEDS[law]] if law in NEEDS else sticky
        best = max(one.likelihood for one in found.values())
        near = start.likelihood > best - case.settings.spreading.law_nats
        if law not in found and (near or law not in NEEDS):
            found[law] = refine_valve(case, start, 0.06, law=law)
    return tuple(sorted(found.values(), key=lambda one: -round(one.likelihood, 6)))
