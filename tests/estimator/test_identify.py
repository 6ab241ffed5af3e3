"""Windows with a known valve, and healthy ones that oscillate for other reasons."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.loops import named_loop
from benchmarks.recording import record
from compensator.conventional.unaware import UnawareMpc
from estimator import EstimatorError, Verdict, identify
from fieldlink.lab.study.closed_loop import EXAMPLE_1, EXAMPLE_2, Study, run
from loop_model import LoopModel, ProcessModel, ValveModel
from tests.seeds import few_and_all, in_suite


@pytest.mark.parametrize("band", [2.0, 8.0])
def test_a_sticky_valve_is_found_and_measured(loop, band: float) -> None:
    op, pv, stem = loop(ValveModel(band, 0.4 * band), noise=0.01 * band, seed=1)
    result = identify(op, pv)
    assert result.verdict is Verdict.STICTION
    assert result.stick_band.value == pytest.approx(band, rel=0.02)
    # J trades against the gain at a constant set-point: the slips stand right, not their size
    assert np.corrcoef(result.stem, stem)[0, 1] > 0.85


def test_a_sticky_valve_of_a_level_is_found(loop) -> None:
    op, pv, _ = loop(ValveModel(5.0, 2.0), integrating=True, noise=0.05, seed=2)
    assert identify(op, pv).verdict is Verdict.STICTION


@pytest.mark.parametrize(
    "options",
    [
        {"sine": 1.0, "noise": 0.05},
        {"sine": 0.5, "drift": 0.05},
        {"aggressive": 2.2, "drift": 0.02},
        {"drift": 0.05, "setpoints": (7.0, 11.0, 5.0, 9.0)},
        {"integrating": True, "sine": 0.5},
    ],
    ids=["sine", "sine and drift", "aggressive", "set-points and drift", "level with sine"],
)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_healthy_valve_is_not_accused(loop, options: dict, seed: int) -> None:
    op, pv, _ = loop(None, seed=seed, **options)
    assert identify(op, pv).verdict is not Verdict.STICTION


def _example(example: LoopModel, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    gain = example.process.gain
    study = Study(
        setpoint=[(0, 50.0 * gain), (300, 55.0 * gain), (700, 48.0 * gain), (1100, 53.0 * gain)],
        samples=1400,
        equation_noise=noise,
        seed=seed,
        op0=50.0,
    )
    trace = run(example.process, example.valve, UnawareMpc(example.process), study)
    return trace.op[400:], trace.pv[400:]


@pytest.mark.parametrize(
    ("example", "noise"),
    [(EXAMPLE_1, 1e-2), (EXAMPLE_2, 10**-1.5)],
    ids=["example 1", "example 2"],
)
@pytest.mark.parametrize("seeds", few_and_all(6, range(20)))
def test_examples_of_the_paper(example: LoopModel, noise: float, seeds: Sequence[int]) -> None:
    # (15) and (18) under the unaware MPC, windows that begin in mid-cycle
    errors = []
    for seed in seeds:
        result = identify(*_example(example, noise, seed))
        assert result.verdict is Verdict.STICTION
        errors.append(
            (
                abs(result.stick_band.value / example.valve.stick_band - 1.0),
                abs(result.slip_jump.value / example.valve.slip_jump - 1.0),
                abs(result.process.gain / example.process.gain - 1.0),
            )
        )
    median = np.median(errors, axis=0)
    assert median[0] <= 0.01
    assert median[1] <= 0.15
    assert median[2] <= 0.05


@pytest.mark.parametrize("criterion", ["oe", "arx"])
def test_criteria_agree_about_the_valve_of_example_1(criterion: str) -> None:
    op, pv = _example(EXAMPLE_1, 1e-2, 0)
    result = identify(op, pv, criterion=criterion)
    assert result.verdict is Verdict.STICTION
    assert result.stick_band.value == pytest.approx(EXAMPLE_1.valve.stick_band, rel=0.05)


def test_the_cost_map_changes_nothing_and_is_least_near_the_estimate() -> None:
    op, pv = _example(EXAMPLE_1, 1e-2, 0)
    plain, mapped = identify(op, pv), identify(op, pv, surface=True)
    assert plain.stick_band == mapped.stick_band
    assert plain.surface is None
    assert mapped.surface is not None
    at, _ = np.unravel_index(int(np.nanargmin(mapped.surface.cost)), mapped.surface.cost.shape)
    step = float(np.diff(mapped.surface.stick_band[:2])[0])
    assert abs(mapped.surface.stick_band[at] - mapped.stick_band.value) <= step


def _slowest(model: LoopModel) -> float:
    return float(np.abs(np.roots([1.0, *model.process.a])).max())


@pytest.mark.parametrize("name", in_suite(2, ["s44", "s78", "s13"]))
def test_a_process_that_hardly_settles_is_given_a_model_that_simulates(name: str) -> None:
    # load steps or an integrating process: a regression's slowest pole would be beyond 1
    loop = named_loop(name)
    window = record(loop, samples=1000)
    result = identify(window.op, window.pv)
    assert result.model is not None
    assert _slowest(result.model) <= 1.0 + 1e-9
    assert np.isfinite(result.pv_model).all()
    assert result.stick_band.value == pytest.approx(loop.stick_band, rel=0.05)


def test_open_loop_step_gives_the_process() -> None:
    # an analytic case: first-order process of gain 2 and time constant 5, healthy valve
    pole = float(np.exp(-1.0 / 5.0))
    truth = ProcessModel((-pole,), (2.0 * (1.0 - pole),), 3, 1.0, 1.0)
    op = np.repeat(np.random.default_rng(1).normal(12.0, 2.0, 80), 6)
    pv = truth.simulate(op) + 0.01 * np.random.default_rng(0).normal(size=op.size)
    result = identify(op, pv, criterion="oe")
    # a band smaller than the steps of OP changes nothing
    assert result.verdict is Verdict.NO_STICTION
    assert result.stick_band.low == 0.0
    assert result.stick_band.high < float(np.median(np.abs(np.diff(op)[np.diff(op) != 0.0])))
    assert result.fit.r2_healthy_valve > 0.999
    assert result.process.gain == pytest.approx(2.0, rel=0.02)
    # the centre of the coefficients of OP: dead time and a share of a sample
    assert result.model is not None
    b = np.array(result.model.process.b)
    late = result.model.process.dead_time + float(b @ np.arange(b.size) / b.sum())
    assert late == pytest.approx(3.0, abs=0.1)


def test_the_model_for_the_controller_simulates_what_was_identified(sticky_window) -> None:
    op, pv, _ = sticky_window
    result = identify(op, pv, criterion="oe")
    assert result.model is not None
    simulated = result.model.process.simulate(result.stem)
    late = slice(150, None)  # the state before the window has died away
    np.testing.assert_allclose(simulated[late], result.pv_model[late], atol=0.02 * np.ptp(pv))
    assert result.model.valve.stick_band == result.stick_band.value


def test_the_model_s_pv_stays_near_pv_where_the_window_begins(loop) -> None:
    # a fast process: nothing of its first state is left when the samples begin to count
    op, pv, _ = loop(ValveModel(4.0, 1.5), noise=0.1, seed=3)
    result = identify(op, pv, criterion="oe")
    assert np.abs(result.pv_model - pv).max() < 2.0 * np.ptp(pv)
    shipped = Path(__file__).parents[2] / "site_configs" / "FC202.csv"
    recorded = pd.read_csv(shipped)
    result = identify(recorded["op"], recorded["pv"], period=2.0)
    assert np.abs(result.pv_model - recorded["pv"].to_numpy()).max() < 2.0 * np.ptp(recorded["pv"])


def test_arx_can_be_asked_for(sticky_window) -> None:
    op, pv, _ = sticky_window
    result = identify(op, pv, criterion="arx")
    assert result.criterion == "arx"
    assert result.process.structure.startswith("arx(")
    assert result.stick_band.value == pytest.approx(5.0, rel=0.1)


def test_intervals_hold_their_values_and_widen_with_confidence(sticky_window) -> None:
    op, pv, _ = sticky_window
    narrow, wide = (identify(op, pv, confidence=c) for c in (0.6, 0.95))
    for name in ("stick_band", "slip_jump", "static_friction", "dynamic_friction"):
        small, large = getattr(narrow, name), getattr(wide, name)
        assert small.low <= small.value <= small.high
        assert large.low <= small.low + 1e-12
        assert large.high >= small.high - 1e-12


@pytest.mark.parametrize("method", in_suite(2, ["grid", "nlp-polish", "nlp"]))
def test_the_paper_s_methods_answer_in_the_same_form(sticky_window, method: str) -> None:
    op, pv, _ = sticky_window
    ours, theirs = identify(op, pv, criterion="arx"), identify(op, pv, method=method)
    assert theirs.verdict is ours.verdict
    assert theirs.criterion == "arx"
    assert theirs.process.structure == ours.process.structure
    assert np.isnan(theirs.stick_band.low)
    s, j = theirs.stick_band.value, theirs.slip_jump.value
    assert theirs.static_friction.value == pytest.approx(0.5 * (s + j))
    assert 0.0 <= j <= s <= 1.05 * np.ptp(op)
    if method == "nlp-polish":  # never worse than the start
        assert s == pytest.approx(ours.stick_band.value, rel=0.02)


def test_the_paper_s_methods_refuse_bad_samples(sticky_window) -> None:
    op, pv, _ = sticky_window
    pv = pv.copy()
    pv[10] = np.nan
    with pytest.raises(EstimatorError, match="use method 'search'"):
        identify(op, pv, method="grid")


def test_a_step_behind_an_integrator_without_noise_is_an_answer_not_an_error() -> None:
    step = np.where(np.arange(200) < 100, 40.0, 60.0)
    op = step + 1e-3 * np.random.default_rng(14).normal(size=200)
    for criterion in ("auto", "oe", "arx"):
        result = identify(op, np.cumsum(op - op.mean()), criterion=criterion)
        assert result.verdict is not Verdict.STICTION  # one stroke
        assert result.reasons
        json.dumps(result.to_dict(), allow_nan=False)
