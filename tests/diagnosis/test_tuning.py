"""Proposed settings: published rules on known processes, and what they do to a record."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.diagnosis_families.tuning.paced import draw_paced
from estimator.diagnosis.linear_loop import LinearLoop
from estimator.diagnosis.replay import Replay
from estimator.diagnosis.tuning_rules import largest_integral_gain, simc
from estimator.valves.laws import stem_of
from fieldlink.diagnosis import Controller, diagnose
from loop_model import ProcessModel
from tests.closed_loop import run

STEPS = np.repeat([0.0, 3.0, -1.0, 2.0, -3.0, 1.0], 250)
RUNNING = Controller(
    structure="PI", gain=0.8, integral_time_s=12.0, derivative_time_s=0.0,
    integral_rate=0.8 / 12.0, filter_time_s=0.0, derivative_on="error", delay=0, explained=1.0,
    exact=True,
)  # fmt: skip


def lag(time: float, gain: float, dead_time: int) -> ProcessModel:
    pole = math.exp(-1.0 / time)
    return ProcessModel((-pole,), (gain * (1.0 - pole),), dead_time, 0.0, 1.0)


def test_simc_of_a_lag_with_dead_time() -> None:
    # effective dead time 4.5: five samples less half of one that the hold adds twice
    (pi,) = simc(lag(20.0, 2.0, 5), RUNNING)
    assert pi.gain == pytest.approx(20.0 / (2.0 * 2.0 * 4.5))
    assert pi.integral_time_s == pytest.approx(20.0)
    assert LinearLoop.of(lag(20.0, 2.0, 5), pi).margins().sensitivity == pytest.approx(1.6, abs=0.1)


def test_simc_of_an_integrator_and_of_two_lags() -> None:
    (pi,) = simc(ProcessModel((-1.0,), (-0.05,), 3, 0.0, 1.0), RUNNING)
    assert pi.gain == pytest.approx(-1.0 / (0.05 * 2.0 * 2.5))
    assert pi.integral_time_s == pytest.approx(8.0 * 2.5)
    slow, fast = math.exp(-1.0 / 30.0), math.exp(-1.0 / 8.0)
    gain = 1.5 * (1.0 - slow) * (1.0 - fast)
    pi, pid = simc(ProcessModel((-slow - fast, slow * fast), (gain,), 2, 0.0, 1.0), RUNNING)
    assert (pi.structure, pid.structure) == ("PI", "PID")
    # in series form Kc 30 / (1.5 * 3), Ti 12, Td 8; the ideal form of it
    assert pid.gain == pytest.approx(30.0 / 4.5 * (1.0 + 8.0 / 12.0))
    assert pid.integral_time_s == pytest.approx(12.0 + 8.0)
    assert pid.derivative_time_s == pytest.approx(8.0 / (1.0 + 8.0 / 12.0))


def test_the_largest_integral_gain_has_the_robustness_that_was_asked_for() -> None:
    process = lag(20.0, -2.0, 5)
    pi = largest_integral_gain(process, RUNNING, 1.6)
    assert pi is not None
    assert pi.gain < 0.0
    assert LinearLoop.of(process, pi).margins().sensitivity == pytest.approx(1.6, rel=0.01)


def test_a_record_replayed_under_its_own_controller_is_the_record() -> None:
    loop = run(sp=STEPS)
    process = ProcessModel(
        (-math.exp(-1.0 / 12.0),), (1.5 * (1.0 - math.exp(-1.0 / 12.0)),), 4, 0.0, 1.0
    )
    op, pv = Replay.of(process, loop.op, loop.pv).run(RUNNING, loop.sp)
    assert np.std(loop.sp - pv) == pytest.approx(np.std(loop.sp - loop.pv), rel=0.02)
    assert np.abs(op - loop.op)[200:].max() < 0.5


@pytest.mark.parametrize("law", ["he", "sliding"])
def test_a_replayed_valve_moves_by_the_law_that_was_found(law: str) -> None:
    # PV is the stem of the sample before and a wave; the controller integrates
    follows = ProcessModel((0.0,), (1.0,), 1, 0.0, 1.0)
    integral = replace(RUNNING, gain=0.0, integral_rate=1.0)
    friction = (1.6, 0.4)
    wave = 0.5 * np.sin(2.0 * np.pi * np.arange(400) / 80.0)
    op, pv = Replay(follows, 0.0, wave).run(
        integral, np.zeros(wave.size), friction=friction, slides=law == "sliding"
    )
    stem = (pv - wave)[1:]
    assert np.ptp(stem) > 2.0
    assert stem == pytest.approx(stem_of(op, law, (2.0, 1.2, float(stem[0])))[:-1])


@pytest.mark.parametrize("seed", [8216, 8222])
def test_the_range_holds_the_error_of_a_valve_that_slides(seed: int) -> None:
    loop = draw_paced("sliding_valve", seed)
    told = diagnose(loop.op, loop.pv, loop.sp, period=loop.period).tuning
    assert told is not None
    new = draw_paced("sliding_valve", seed, settings=(
        told["gain"], told["integral_time_s"] / loop.period))  # fmt: skip
    error = float(np.std(new.sp - new.pv))
    assert told["predicted_error_std_low"] <= error <= told["predicted_error_std_high"]


def test_new_settings_do_what_was_predicted() -> None:
    loop = run(gain=2.4, integral_time=10.0, sp=STEPS)
    answer = diagnose(loop.op, loop.pv, loop.sp).tuning
    assert answer is not None
    assert answer["ms"] == pytest.approx(1.6, rel=0.02)
    for one in (answer, *answer["alternatives"]):
        again = run(gain=one["gain"], integral_time=one["integral_time_s"],
                    derivative_time=one["derivative_time_s"], sp=STEPS)  # fmt: skip
        real = float(np.std(again.sp - again.pv))
        assert one["predicted_error_std"] == pytest.approx(real, rel=0.15)
        assert one["predicted_error_std_low"] <= real <= one["predicted_error_std_high"]


def test_a_process_that_hardly_shows_gives_no_advice() -> None:
    loads = np.repeat(np.random.default_rng(4).uniform(-6.0, 6.0, 15), 100)
    loop = run(gain=0.15, integral_time=30.0, load=loads)
    assert diagnose(loop.op, loop.pv, loop.sp).tuning is None


@pytest.mark.parametrize("gain", [0.95, 1.05])
def test_a_loop_that_swings_by_itself_for_few_periods_is_not_slow(gain: float) -> None:
    for seed in (1, 2):
        loop = run(gain=gain, integral_time=4.0, process_gain=0.5, lag=14.0, dead=12, n=750,
                   noise=0.03, seed=seed)  # fmt: skip
        found = diagnose(loop.op, loop.pv, loop.sp, period=1.0, advice=False, figures=False)
        assert found.oscillation.present
        assert "slow_tuning" not in [cause.name for cause in found.causes]
