"""What speaks for a sticky valve: the estimator's search, weighed against every other explanation.

The verdict is the estimator's own rule (`estimator.evidence.verdict`), against more rivals, and
stricter where a stroke is longer than a part of the window. The valve must be the likelier one
under a long noise model as well (`estimator.diagnosis.long_noise`), and is looked for under it too
where the noise asks for the longest model of the verdict.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator.diagnosis import rivals
from estimator.diagnosis.advice_settings import Advising
from estimator.diagnosis.long_noise import under_long_noise, with_long_noise
from estimator.diagnosis.rivals import Rival, without_best
from estimator.diagnosis.settings import Weighing
from estimator.evidence.effect import effect_of
from estimator.evidence.slip_frictions import find_varying_friction
from estimator.evidence.verdict import count_strokes
from estimator.evidence.weighing import fit_healthy, weigh
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.uneven_wave import UnevenWave
from estimator.search.descent import refine_valve
from estimator.search.processes import polish, settle

__all__ = ["ValveEvidence", "judge_valve"]


@dataclass(frozen=True, slots=True)
class ValveEvidence:
    """What speaks for a sticky valve.

    Attributes:
        fit: the likeliest one, None where none was looked for or found.
        evidence, spread: see `Explained.sticking` and `Explained.spread`.
        effect: share of PV's variance that sticking makes.
        sticks: whether all of it is enough for a verdict.
        over_waves: see `Explained.over_waves`.
        waved: the healthy valve beside a load that swings unevenly, where the estimator found that
            one likelier than any sticky valve; else None.
    """

    fit: Hypothesis | None = None
    evidence: float = -math.inf
    spread: float = -math.inf
    effect: float = 0.0
    sticks: bool = False
    over_waves: float = math.inf
    waved: Hypothesis | None = None


def judge_valve(
    case: Case,
    cycles: float,
    weighing: Weighing,
    advising: Advising,
    *,
    valve_is_healthy: bool = False,
    as_recorded: Case | None = None,
) -> tuple[ValveEvidence, Hypothesis]:
    """The sticky valve against every rival, and the healthy valve with nothing beside it.

    Args:
        case: the rows.
        cycles: periods of the window's oscillation, NaN where nothing oscillates.
        weighing, advising: of the diagnosis.
        valve_is_healthy: whether no valve is looked for.
        as_recorded: the same rows with OP not delayed, for a second search; None for none.
    """
    if valve_is_healthy:
        return ValveEvidence(), settle(case, fit_healthy(case))
    found = weigh(case)
    plain = found.healthy
    waved = plain if any(isinstance(one, UnevenWave) for one in plain.nuisances) else None
    if plain.nuisances:
        plain = settle(case, polish(case, None, plain, (), plain.taps, wide=True))
    sticky, judging = found.sticky, case.settings.judging
    low, high = weighing.in_doubt
    if sticky is not None and as_recorded is not None and low < found.evidence < high:
        sticky = _search_again(case, sticky, as_recorded)
    others = [Rival(case, plain), Rival(case, found.healthy)]
    if found.evidence < high and plain.taps.size == max(case.settings.modelling.noise_orders):
        # noise that asks for the longest model there is may ask for a longer one
        longer = weigh(with_long_noise(case, advising))
        if longer.sticky is not None and longer.evidence > 0.0:
            moved = _moved(case, longer.sticky)
            sticky = moved if sticky is None or moved.likelihood > sticky.likelihood else sticky
            # what the longer search knows of a healthy valve counts as well
            others.append(Rival(case, _settled(case, longer.healthy)))
    if sticky is None:
        return ValveEvidence(waved=waved), plain
    evidence = sticky.likelihood - max(one.likelihood for one in others)
    if evidence <= 0.0:
        return ValveEvidence(sticky, evidence, waved=waved), plain
    others += rivals.waves(case, plain, cycles, weighing)
    others += rivals.curved(case, plain, weighing)
    rival = max(others, key=lambda one: one.likelihood)
    evidence = sticky.likelihood - rival.likelihood
    if evidence > 0.0:
        left = under_long_noise(case, sticky, case, plain, advising)
        if left <= 0.0:
            return ValveEvidence(sticky, left), plain
    if evidence < judging.threshold:
        return ValveEvidence(sticky, evidence), plain
    few, spread, sticks = _shown(case, rival, sticky)
    if not sticks:
        # a law may have lost a valve whose friction changes from slip to slip
        varying = find_varying_friction(case, sticky)
        if varying is not None:
            few, spread, sticks = _shown(case, rival, varying.hypothesis)
    if few:
        return ValveEvidence(sticky, evidence), plain
    # a valve that was found in another search is likelier than the one that was compared
    over_waves = found.over_waves
    if found.sticky is not None:
        over_waves += sticky.likelihood - found.sticky.likelihood
    return (
        ValveEvidence(sticky, evidence, spread, effect_of(case, sticky), sticks, over_waves),
        plain,
    )


def _shown(case: Case, rival: Rival, sticky: Hypothesis) -> tuple[bool, float, bool]:
    """Whether a valve makes too few strokes, its evidence without the best part, and if it sticks.

    The evidence is over a rival, in nats; all of the window must show that the valve sticks.
    """
    judging, screening = case.settings.judging, case.settings.screening
    strokes = count_strokes(sticky.stem)
    if strokes < screening.min_strokes:
        return True, math.nan, False
    # no part is shorter than a stroke: it would leave most of the one that shows it all
    spread = without_best(case, rival, sticky, min(judging.parts, max(2, strokes)))
    enough, from_there = judging.few
    assert sticky.valve is not None
    sticks = (
        spread >= judging.steady
        and sticky.valve.band >= screening.min_band
        and (strokes >= enough or spread >= from_there)
    )
    return False, spread, sticks


def _search_again(case: Case, sticky: Hypothesis, other: Case) -> Hypothesis:
    """The likelier of a valve and that of a second search, both on the same rows.

    A search tries some dead times only; delayed rows and rows as recorded differ in which.
    """
    again = weigh(other).sticky
    if again is None:
        return sticky
    moved = _moved(case, again)
    return moved if moved.likelihood > sticky.likelihood else sticky


def _moved(case: Case, sticky: Hypothesis) -> Hypothesis:
    """A sticky valve of a search on other rows, at its likeliest on these."""
    return refine_valve(case, _settled(case, sticky), _NEAR)


def _settled(case: Case, of: Hypothesis) -> Hypothesis:
    return settle(case, polish(case, of.valve, of, of.nuisances, of.taps, wide=True))


_NEAR = 0.03
"""First reach of the refinement of a valve that was found on rows shifted by a sample, as a share
of its stick band."""
