"""The likeliest sticky valves of a window: several looks at all of them, then closer."""

from __future__ import annotations

import numpy as np

from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.nuisances import Nuisance
from estimator.processes.poles import Poles, Shape
from estimator.search.coarse import first_apart, one_step_starts, simulated_starts
from estimator.search.descent import refine_valve
from estimator.search.processes import polish

__all__ = ["find_valves"]

_SAME = 0.02
"""Stick bands that differ by less, as a share, are one valve."""


def find_valves(
    case: Case, near: Hypothesis, nuisances: tuple[Nuisance, ...] = ()
) -> tuple[Hypothesis, ...]:
    """The most likely sticky valves, the likeliest first.

    Empty where no valve moves often enough. Valves are looked at by simulation under several noise
    models, and He's also by one-step errors: which of them shows the valve depends on what else
    moves PV.
    """
    searching = case.settings.searching
    ended: list[Hypothesis] = []
    for law in searching.laws:
        starts = _starts(case, near, nuisances, law)
        found = [
            polish(case, one.valve, one, nuisances, one.taps, passes=2, wide=False)
            for one in _best_apart(starts, searching.polished)
        ]
        ended += [refine_valve(case, one) for one in _best_apart(found, searching.refined)]
    return tuple(sorted(ended, key=lambda one: -round(one.likelihood, 6)))


def _starts(
    case: Case, near: Hypothesis, nuisances: tuple[Nuisance, ...], law: str
) -> list[Hypothesis]:
    """The valves of one law that one of the looks takes for likely."""
    starts = [
        case.fit(start.valve, start.poles, start.dead_time, nuisances, taps)
        for start, taps in simulated_starts(case, near, nuisances, law)
    ]
    if law == "he":
        for valve, dead_time in one_step_starts(case, near, nuisances):
            lag = Poles(Shape.LAGS, 6.0), dead_time
            starts.append(polish(case, valve, lag, nuisances, near.taps, passes=2, wide=True))
    return starts


def _best_apart(found: list[Hypothesis], count: int) -> list[Hypothesis]:
    """The likeliest ones that are not the same valve, at most ``count``."""
    bands = np.array([one.valve.band for one in found if one.valve is not None])
    costs = np.array([-one.likelihood for one in found])
    return [found[i] for i in first_apart(bands, costs, count, _SAME)]
