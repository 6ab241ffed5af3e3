"""OP that stands still: a limit, a hand, or nothing to do; and what such times hide."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.diagnosis_families.tuning.singles import draw_loop
from estimator.controller.controller import Controller
from estimator.diagnosis.facts import by_hand_of
from estimator.diagnosis.loop_record import loop_record, with_own_setpoint
from estimator.diagnosis.settings import DIAGNOSIS
from fieldlink.diagnosis import Diagnosis, diagnose, read_controller
from tests.closed_loop import run

PI = Controller("PI", 0.8, 12.0, 0.0, 0.8 / 12.0, 0.0, "error", 0, 1.0, True)


def share_by_hand(error: np.ndarray) -> float:
    """Of 400 samples, 200 with OP at its highest value; a positive error asks for more."""
    op = np.concatenate([np.linspace(40.0, 60.0, 200), np.full(200, 60.0)])
    beside = np.concatenate([np.ones(200), error])
    return float(np.mean(by_hand_of(op, None, beside, PI, DIAGNOSIS.facts)))


def test_errors_tell_a_limit_from_a_hand_where_no_mode_was_recorded() -> None:
    swings = np.sin(2.0 * np.pi * np.arange(200) / 50.0)
    # the error asks for less: a controller would leave its limit
    assert share_by_hand(-0.5 + swings) == pytest.approx(0.5, abs=0.01)
    assert share_by_hand(0.5 + swings) == 0.0
    # an integral that was wound up holds OP until the errors have undone it
    assert share_by_hand(np.linspace(1.0, -0.9, 200)) == 0.0


def test_op_that_stands_still_without_an_error_is_not_in_manual() -> None:
    op, error = np.repeat([50.0, 51.0, 52.0], 100), np.zeros(300)
    error[[99, 199]] = 1.0
    assert np.mean(by_hand_of(op, None, error, PI, DIAGNOSIS.facts)) < 0.01


@pytest.mark.parametrize("seed", range(1, 6))
def test_the_set_point_shows_in_the_moves_of_op_beside_a_limit(seed: int) -> None:
    load = -12.0 - 8.0 * np.sin(2.0 * np.pi * np.arange(1500) / 700.0)
    loop = run(load=load, limits=(0.0, 60.0), seed=seed)
    record = loop_record(loop.op, loop.pv, None, None, 1.0)
    found = with_own_setpoint(record, read_controller(loop.op, loop.pv), DIAGNOSIS)
    assert record.error is not None
    assert found.error is not None
    # the mean of PV is half a unit off: OP cannot do more for a third of the time
    assert abs(np.mean(record.error - (loop.sp - loop.pv))) > 0.4
    assert abs(np.mean(found.error - (loop.sp - loop.pv))) < 0.05


def found(causes: tuple[str, ...], seed: int) -> Diagnosis:
    loop = draw_loop(causes, seed)
    return diagnose(loop.op, loop.pv, loop.sp, auto=loop.auto, period=loop.period, advice=False)


@pytest.mark.parametrize("seed", [5006, 5009, 5017])
def test_what_swings_before_and_after_a_frozen_third_of_the_record_is_told(seed: int) -> None:
    answer = found(("tight_tuning", "sensor"), seed)
    assert {cause.name for cause in answer.causes} == {"tight_tuning", "sensor"}


@pytest.mark.parametrize("seed", [5009, 5019])
def test_a_wave_that_goes_on_while_op_stands_at_its_limit_is_told(seed: int) -> None:
    answer = found(("saturation", "external_oscillation"), seed)
    assert {cause.name for cause in answer.causes} == {"saturation", "external_oscillation"}


@pytest.mark.parametrize(("sensor", "seed"), [(True, 5010), (False, 5001), (False, 5008)])
def test_noise_counts_beside_what_the_oscillation_leaves(sensor: bool, seed: int) -> None:
    causes = ("tight_tuning", "sensor") if sensor else ("tight_tuning",)
    assert {cause.name for cause in found(causes, seed).causes} == set(causes)
