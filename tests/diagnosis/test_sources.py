"""A sticky valve under a wave from outside: the group that the wave makes did not begin there."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from estimator.diagnosis.coherence import spectrum_of
from estimator.diagnosis.settings import DIAGNOSIS
from estimator.diagnosis.sources import GroupMembers, is_valve_doubted, rank_candidates
from fieldlink.diagnosis import Cause, CauseName, Diagnosis, LoopSignals, diagnose, find_groups
from tests.closed_loop import Loop, run
from tests.seeds import in_suite


@cache
def group_of_two(seed: int) -> tuple[dict[str, LoopSignals], dict[str, Diagnosis]]:
    """A sticky loop and one that it moves."""
    source = run(band=6.0, jump=4.0, seed=seed)
    follower = run(load=1.5 * (source.op - source.op.mean()), lag=20.0, seed=seed + 50)
    loops: dict[str, Loop] = {"A": source, "B": follower}
    signals = {name: LoopSignals(one.op, one.pv, one.sp, 1.0) for name, one in loops.items()}
    found = {name: diagnose(one.op, one.pv, one.sp, advice=False) for name, one in loops.items()}
    return signals, found


def beside_a_wave(found: dict[str, Diagnosis], period_s: float) -> dict[str, Diagnosis]:
    """What was found, the first loop told to hold a wave of that period."""
    first = found["A"]
    indices = dict(first.indices) | {"wave_beside_valve_period_s": period_s}
    return found | {"A": replace(first, indices=indices)}


@pytest.mark.parametrize("seed", in_suite(1, [3, 1, 2]))
def test_a_wave_of_the_groups_period_beside_a_sticky_valve_began_elsewhere(seed: int) -> None:
    signals, alone = group_of_two(seed)
    (group,) = find_groups(signals, beside_a_wave(alone, np.nan))
    assert group.candidates[0].loop == "A"
    for share in (1.05, 1.0 / 3.0):
        found = beside_a_wave(alone, share * group.period_s)
        assert find_groups(signals, found)[0].candidates[0].loop != "A"
    # a wave of another period says nothing of this one
    found = beside_a_wave(alone, 0.7 * group.period_s)
    assert find_groups(signals, found)[0].candidates[0].loop == "A"


def stuck(one: Diagnosis, nats: float) -> Diagnosis:
    """The diagnosis of a loop whose valve was called sticky, with so much evidence."""
    sticky = Cause(CauseName.STICKY_VALVE, 1.0, ("strokes",))
    indices = dict(one.indices) | {"log_bayes_factor_sticky": nats}
    return replace(one, causes=(sticky,), indices=indices)


def test_of_two_sticky_valves_the_one_with_far_more_evidence_is_the_source() -> None:
    signals, alone = group_of_two(3)
    nats = float(alone["A"].indices["log_bayes_factor_sticky"])
    assert nats > 100.0
    for named, other in (("A", "B"), ("B", "A")):
        both = {named: stuck(alone[named], 40.0 * nats), other: stuck(alone[other], 0.2 * nats)}
        weights = {
            one.loop: one.weight
            for one in find_groups(signals, both)[0].candidates
        }  # fmt: skip
        even = {name: stuck(one, nats) for name, one in alone.items()}
        before = {one.loop: one.weight for one in find_groups(signals, even)[0].candidates}
        assert weights[named] / weights[other] > 100.0 * before[named] / before[other]


def test_a_valve_that_is_hardly_sticky_is_less_likely_than_a_source_outside() -> None:
    signals, alone = group_of_two(3)
    victims = {name: stuck(one, 11.0) for name, one in alone.items()}
    assert find_groups(signals, victims)[0].candidates[0].loop is None


def test_a_valve_that_an_uneven_wave_may_stand_for_is_no_likely_source() -> None:
    signals, alone = group_of_two(3)
    (group,) = find_groups(signals, alone)
    assert group.candidates[0].loop == "A"
    indices = dict(alone["A"].indices) | {"log_bayes_factor_over_uneven_wave": -40.0}
    doubted = alone | {"A": replace(alone["A"], indices=indices)}
    spectra = {name: spectrum_of(one) for name, one in signals.items()}
    members = GroupMembers(group.loops, group.period_s, signals, spectra, doubted, ())
    first, *others = rank_candidates(members, DIAGNOSIS)
    assert first.loop is None
    of_valve = next(one for one in others if one.loop == "A")
    assert any("may stick, but an uneven wave" in text for text in of_valve.against)
    # nor is it asked whom it moves
    assert all(found.candidates[0].loop != "A" for found in find_groups(signals, doubted))


def test_a_valve_that_is_surely_likelier_than_an_uneven_wave_is_not_doubted() -> None:
    _, alone = group_of_two(3)
    sure = DIAGNOSIS.judging.threshold
    for over, doubted in ((sure - 0.1, True), (sure, False), (np.nan, False)):
        indices = dict(alone["A"].indices) | {"log_bayes_factor_over_uneven_wave": over}
        assert is_valve_doubted(replace(alone["A"], indices=indices), DIAGNOSIS) is doubted
