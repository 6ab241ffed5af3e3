"""The likeliest sticky valves of a window: several looks at all of them, then closer."""

from __future__ import annotations

import numpy as np

from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.noise import DRIFT_AND_NOISE, LOOKS
from estimator.hypotheses.nuisances import Nuisance, Sinusoid
from estimator.processes.poles import Poles, Shape
from estimator.search.coarse import Look, first_apart, one_step_starts, ranking_of, simulated_starts
from estimator.search.descent import refine_valve
from estimator.search.processes import polish
from estimator.search.ranking import Ranking

__all__ = ["find_valves"]

_HOPELESS = 10.0
"""Nats by which the best valve of the first law may be behind the healthy one before those of other
laws are looked for around it only (tuning family: no valve lost; at 6 nats some are)."""
_SAME = 0.02
"""Stick bands that differ by less, as a share, are one valve."""


def find_valves(
    case: Case,
    near: Hypothesis,
    nuisances: tuple[Nuisance, ...] = (),
    *,
    by_simulation: bool = True,
) -> tuple[Hypothesis, ...]:
    """The most likely sticky valves, the likeliest first.

    Empty where no valve moves often enough. Valves of the first law are looked at by one-step
    errors and, where those show no clear one, by simulation under several noise models: which of
    them shows the valve depends on what else moves PV. Where a valve is clear or hopeless under
    the first law, or disturbances are known already, those of the other laws are looked for around
    it only. Without ``by_simulation`` one-step errors alone show them: enough for a better one than
    a clear valve.
    """
    searching = case.settings.searching
    looks = tuple(Look(nuisances, taps) for taps in LOOKS)
    if not nuisances:
        looks += tuple(Look((wave,), DRIFT_AND_NOISE) for wave in _own_wave(case))
    first, *others = searching.laws
    starts = _one_step(case, near, nuisances)
    lead = max((one.likelihood for one in starts), default=-np.inf) - near.likelihood
    ranking = None
    if by_simulation and lead < searching.ahead:
        ranking = ranking_of(case, near, looks)
        starts = _simulated(case, ranking, looks, first) + starts
    found = _refined(case, starts)
    ended = list(found)
    lead = found[0].likelihood - near.likelihood if found else 0.0
    for law in others:
        if found and (nuisances or lead > searching.ahead or lead < -_HOPELESS):
            ended += [refine_valve(case, one, searching.wide, law) for one in found]
        else:
            ended += _refined(case, _simulated(case, ranking, looks, law))
    return tuple(sorted(ended, key=_likeliest_first))


def _likeliest_first(one: Hypothesis) -> float:
    """Key that sorts hypotheses; rounding decides nothing."""
    return -round(one.likelihood, 6)


def _refined(case: Case, starts: list[Hypothesis]) -> list[Hypothesis]:
    """The best of the starts with their processes fitted, then the best of those refined."""
    searching = case.settings.searching
    found = [
        polish(case, one.valve, one, one.nuisances, one.taps, passes=2, wide=False)
        for one in _best_apart(starts, searching.polished)
    ]
    ended: list[Hypothesis] = []
    for one in _best_apart(found, searching.refined):
        ended.append(refine_valve(case, one, rival=ended[0] if ended else None))
    return sorted(ended, key=_likeliest_first)


def _own_wave(case: Case) -> tuple[Nuisance, ...]:
    """PV's own oscillation as one from outside, if it has one.

    Without it the right valve explains little where another loop swings this one.
    """
    cycles = case.own_cycles
    return () if cycles is None else (Sinusoid(cycles),)


def _simulated(
    case: Case, ranking: Ranking | None, looks: tuple[Look, ...], law: str
) -> list[Hypothesis]:
    """The valves of one law that one of the looks takes for likely; none without a ranking."""
    if ranking is None:
        return []
    return [
        case.fit(start.valve, start.poles, start.dead_time, look.nuisances, look.taps)
        for start, look in simulated_starts(case, ranking, looks, law)
    ]


def _one_step(case: Case, near: Hypothesis, nuisances: tuple[Nuisance, ...]) -> list[Hypothesis]:
    """The valves of the first law whose one-step errors are least, their processes fitted."""
    lag = Poles(Shape.LAGS, 6.0)
    beside = () if nuisances else _own_wave(case)
    return [
        polish(case, valve, (lag, dead_time), known, near.taps, passes=2, wide=True)
        for past in case.settings.searching.pasts
        for valve, dead_time, known in one_step_starts(case, near, nuisances, past, beside)
    ]


def _best_apart(found: list[Hypothesis], count: int) -> list[Hypothesis]:
    """The likeliest ones that are not the same valve, at most ``count``."""
    bands = np.array([one.valve.band for one in found if one.valve is not None])
    costs = np.array([-one.likelihood for one in found])
    return [found[i] for i in first_apart(bands, costs, count, _SAME)]
