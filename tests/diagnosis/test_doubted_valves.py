"""A sticky valve for which an uneven wave may stand, and a wave for which a valve may."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.wandering_loads import draw
from estimator.diagnosis.gather import find_swing, gather
from estimator.diagnosis.gathered import Gathered
from estimator.diagnosis.loop_record import loop_record
from estimator.diagnosis.settings import DIAGNOSIS
from estimator.diagnosis.swing_causes import find_outside
from fieldlink.diagnosis import Diagnosis, diagnose
from tests.closed_loop import run
from tests.seeds import in_suite

WAVE = 4.0 * np.sin(2.0 * np.pi * np.arange(1500) / 70.0)


def uneven_triangle(seed: int) -> np.ndarray:
    """What a neighbour's sticky valve sends: halves of 25 scans that differ by a sixth."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(25.0 * (1.0 + 0.16 * rng.standard_normal(80)))
    return np.asarray(np.interp(np.arange(1500), times, 8.0 * (-1.0) ** np.arange(80)))


@pytest.fixture(scope="module", params=[3469, 3553])
def doubted(request: pytest.FixtureRequest) -> Diagnosis:
    """A wave that is likelier than the valve, if not by enough; and one that is less likely."""
    loop = draw(request.param)
    assert loop is not None
    return diagnose(loop.op, loop.pv, None, period=1.0)


@pytest.mark.parametrize("seed", in_suite(1, [2, 1, 3, 5, 7, 8]))
def test_a_wave_that_is_surely_likelier_than_any_valve_comes_from_outside(seed: int) -> None:
    """The loop, fitted without it, seems to swing by itself."""
    loop = run(load=uneven_triangle(seed), seed=seed)
    answer = diagnose(loop.op, loop.pv, loop.sp, period=1.0, advice=False)
    assert [cause.name for cause in answer.causes] == ["external_oscillation"]


def test_an_uneven_wave_that_explains_pv_as_well_is_told_beside_the_valve(
    doubted: Diagnosis,
) -> None:
    assert {cause.name for cause in doubted.causes} == {"external_oscillation", "sticky_valve"}
    over = doubted.indices["log_bayes_factor_over_uneven_wave"]
    assert over < 10.0
    assert doubted.first.name == ("external_oscillation" if over < 0.0 else "sticky_valve")
    for cause in doubted.causes:
        assert any("either is possible" in sentence for sentence in cause.evidence)
        assert "in manual for a few periods" in cause.action
    sticky = next(cause for cause in doubted.causes if cause.name == "sticky_valve")
    assert not any("any other explanation" in sentence for sentence in sticky.evidence)


def test_nothing_is_proposed_while_valve_or_wave_is_open(doubted: Diagnosis) -> None:
    assert doubted.tuning is None


def test_a_valve_that_no_wave_explains_has_no_such_figure() -> None:
    loop = run(band=6.0, jump=4.0, seed=3)
    answer = diagnose(loop.op, loop.pv, loop.sp, period=1.0, advice=False)
    assert [cause.name for cause in answer.causes] == ["sticky_valve"]
    assert np.isnan(answer.indices["log_bayes_factor_over_uneven_wave"])


def gathered() -> Gathered:
    loop = run(load=WAVE)
    record = loop_record(loop.op, loop.pv, loop.sp, None, 1.0)
    return gather(record, *find_swing(record, DIAGNOSIS), DIAGNOSIS, valve_is_healthy=False).found


def test_a_wave_is_not_told_where_a_sticky_valve_is_likelier() -> None:
    found = gathered()
    assert find_outside(found, DIAGNOSIS) is not None
    assert found.explained is not None
    likelier = replace(found.explained, sticking=8.0, outside=-1.0)
    assert find_outside(replace(found, explained=likelier), DIAGNOSIS) is None
