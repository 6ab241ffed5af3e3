"""The compensation benchmark's figures, on traces whose figures are known."""

import numpy as np
import pytest

from benchmarks.compensation_cases import CASES, MISMATCHES, figures_of, model_of, study_of
from compensator import ActionStatus
from compensator.study import Trace

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
    figures = figures_of(CASE, trace_of(0.3, 0.0), 0.16)
    assert figures.pv_std == pytest.approx(0.0, abs=1e-12)
    assert figures.pv_rms == pytest.approx(0.3)
    assert figures.offset == pytest.approx(0.0, abs=1e-12)  # up once, down once: it cancels
    assert figures.iae == pytest.approx(0.3)
    assert figures.travel == figures.reversals == figures.settling == 0.0


def test_travel_and_reversals_are_per_hundred_samples() -> None:
    figures = figures_of(CASE, trace_of(0.0, 2.0), 0.16)
    # A square wave of period 20 between -2 and 2: ten moves of 4 in 100 samples.
    assert figures.travel == pytest.approx(40.0, rel=0.1)
    assert figures.reversals == pytest.approx(10.0, rel=0.1)


def test_a_loop_that_never_settles_takes_the_whole_segment() -> None:
    assert figures_of(CASE, trace_of(5.0, 0.0), 0.16).settling == 300.0


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
