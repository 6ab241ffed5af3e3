"""The compensation benchmark's figures, on traces whose figures are known."""

import numpy as np
import pytest

from benchmarks.compensation_cases import (
    CASES,
    MISMATCHES,
    SEGMENT,
    WARM,
    figures_of,
    model_of,
    study_of,
)
from benchmarks.compensation_verdicts import best_at, dominated, judge
from compensator import ActionStatus
from fieldlink.lab.study.closed_loop import Trace

CASE = CASES[0]


def trace_of(error: float, stem_swing: float) -> Trace:
    study = study_of(CASE)
    sp = np.full(study.samples, study.setpoint[0][1])
    for sample, value in study.setpoint:
        sp[sample:] = value
    wave = np.where(np.arange(study.samples) % 20 < 10, 1.0, -1.0)
    stem = 50.0 + stem_swing * wave
    status = (ActionStatus.OPTIMAL,) * study.samples
    return Trace(sp + error, stem, stem, sp, status)


def test_a_lasting_error_is_an_offset_and_no_deviation() -> None:
    figures = figures_of(CASE, trace_of(0.3, 0.0), 1)
    assert figures.pv_std == pytest.approx(0.0, abs=1e-12)
    assert figures.pv_rms == pytest.approx(0.3)
    assert figures.raw_offset == pytest.approx(0.3)
    assert figures.offset == pytest.approx(0.3, abs=0.15)  # less the mean of the noise alone
    assert figures.iae == pytest.approx(0.3)
    assert figures.travel == figures.reversals == figures.settling == 0.0


def test_travel_and_reversals_are_per_hundred_samples() -> None:
    figures = figures_of(CASE, trace_of(0.0, 2.0), 1)
    # A square wave of period 20 between -2 and 2: ten moves of 4 in 100 samples.
    assert figures.travel == pytest.approx(40.0, rel=0.1)
    assert figures.reversals == pytest.approx(10.0, rel=0.1)


def test_a_loop_that_never_settles_takes_the_whole_segment() -> None:
    assert figures_of(CASE, trace_of(5.0, 0.0), 1).settling == SEGMENT


def test_mismatches_are_what_their_names_say() -> None:
    truth = CASE.model
    for name, factors in MISMATCHES.items():
        model, _ = model_of(CASE, trace_of(0.0, 0.0), name)
        assert model is not None
        share = model.valve.stick_band / truth.valve.stick_band
        assert share == pytest.approx(factors.get("valve", 1.0))
        assert model.process.gain / truth.process.gain == pytest.approx(factors.get("gain", 1.0))


def test_a_window_without_a_cycle_gives_no_model() -> None:
    study = study_of(CASE)
    noise = np.random.default_rng(1).normal(0.0, 0.1, study.samples)
    quiet = trace_of(0.0, 0.0)
    model, words = model_of(
        CASE, Trace(quiet.sp + noise, quiet.op, quiet.stem, quiet.sp, quiet.status), "identified"
    )
    assert model is None
    assert words != "stiction"


def waves(amplitude: float, begin: int, end: int) -> Trace:
    """Limit cycle of one before the take-over and outside ``begin`` to ``end``, where it grows."""
    quiet = trace_of(0.0, 0.0)
    size = np.ones(quiet.pv.size)
    size[begin:end] = amplitude
    pv = quiet.sp + size * np.sin(2.0 * np.pi * np.arange(quiet.pv.size) / 50.0)
    return Trace(pv, quiet.op, quiet.stem, quiet.sp, quiet.status)


def test_time_to_a_fall_back_is_counted_in_periods_from_where_it_got_worse() -> None:
    begin, lost_at = WARM + 300, WARM + 500
    mine, theirs = waves(2.0, begin, lost_at), waves(1.0, 0, 0)
    judged = judge(CASE, mine, [theirs], lost_at)
    # Four periods, and the one in which it begins.
    assert judged.noticed == pytest.approx(5.0, abs=0.3)
    assert judged.after == pytest.approx(1.0, abs=0.02)
    assert judged.passed


def test_a_fall_back_that_comes_late_or_changes_nothing_does_not_pass() -> None:
    theirs, begin = waves(1.0, 0, 0), WARM + 150
    late = judge(CASE, waves(2.0, begin, begin + 380), [theirs], begin + 380)
    assert late.noticed > 5.0
    assert not late.passed
    useless = judge(CASE, waves(2.0, begin, 10000), [theirs], begin + 150)
    assert useless.after == pytest.approx(2.0, abs=0.05)
    assert not useless.passed
    assert not judge(CASE, waves(1.01, WARM, 10000), [theirs], None).passed
    assert judge(CASE, waves(0.99, WARM, 10000), [theirs], None).passed


def test_a_curve_is_left_behind_where_another_has_less_of_both() -> None:
    ours = [(0.0, 2.0), (10.0, 1.0)]
    assert best_at(ours, 5.0) == pytest.approx(1.5)
    assert best_at(ours, 20.0) == 1.0
    found = dominated({"ours": ours, "theirs": [(5.0, 1.6), (5.0, 1.4), (30.0, 1.1)]}, "ours")
    assert found == ["theirs at travel 5: 1.4 against 1.5"]
