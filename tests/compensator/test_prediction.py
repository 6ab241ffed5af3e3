"""The state space equals the ARX model, and its filter is the Kalman filter."""

import numpy as np
import pytest
from scipy import signal

from compensator import CompensatorError, NoiseModel, Prediction
from compensator.prediction import StateFilter, answer_of
from fieldlink.lab.study.closed_loop import EXAMPLE_1, EXAMPLE_2, Plant
from loop_model import ProcessModel

PROCESSES = [
    EXAMPLE_1.process,
    EXAMPLE_2.process,
    ProcessModel((-0.8,), (0.4,), 6, 3.0, 1.0),
    ProcessModel((-1.6, 0.64), (0.1, -0.3), 2, -1.0, 0.5),
    ProcessModel((-1.0,), (0.05,), 3, 0.2, 1.0),
]


@pytest.mark.parametrize("process", PROCESSES)
def test_state_space_gives_the_arx_model_s_output(process: ProcessModel) -> None:
    stem = np.random.default_rng(1).normal(0.0, 1.0, 60)
    numerator = np.concatenate([np.zeros(process.dead_time), process.b])
    reference = signal.lfilter(numerator, np.concatenate([[1.0], process.a]), stem)
    prediction = Prediction.of(process)
    state = np.zeros(prediction.order)
    pv = []
    for x in stem:
        pv.append(state[0])
        state = prediction.A @ state + prediction.B * x
    np.testing.assert_allclose(pv, reference[: len(pv)], atol=1e-9)


@pytest.mark.parametrize("process", [*PROCESSES, ProcessModel((), (0.2, 0.1, 0.3), 1, 0.0, 1.0)])
def test_the_answer_to_a_drive_is_scipy_s(process: ProcessModel) -> None:
    drive = np.random.default_rng(2).normal(0.0, 1.0, 200)
    expected = signal.lfilter(process.b, [1.0, *process.a], drive)
    np.testing.assert_allclose(answer_of(process, drive), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("share", [0.01, 0.3, 0.99])
def test_what_a_record_shows_too_early_comes_with_the_next_sample(share: float) -> None:
    """A lag of four samples; the record reads PV a share of the period after OP has moved."""
    late, pole = np.exp(-share / 4.0), np.exp(-1.0 / 4.0)
    recorded = ProcessModel((-pole,), (1.0 - late, late - pole), 0, 0.0, 1.0)
    # A controller reads PV, moves OP, and reads PV again after the whole period.
    expected = 1.0 - pole ** np.arange(1, 13)
    np.testing.assert_allclose(Prediction.of(recorded).step_response(12), expected, rtol=1e-12)
    plant = Plant(recorded, None, 0.0)
    np.testing.assert_allclose([plant.step(1.0) for _ in range(12)], expected, rtol=1e-12)
    alone = ProcessModel((-0.5,), (0.2,), 0, 0.0, 1.0).as_controlled()
    assert (alone.b, alone.dead_time) == ((0.2,), 1)


@pytest.mark.parametrize("process", PROCESSES)
def test_equilibrium_stays_where_it_is(process: ProcessModel) -> None:
    prediction = Prediction.of(process)
    state, op = prediction.equilibrium(7.0, prediction.rest)
    drive = op + (prediction.rest if prediction.input_disturbance else 0.0)
    np.testing.assert_allclose(prediction.A @ state + prediction.B * drive, state, atol=1e-9)
    shift = 0.0 if prediction.input_disturbance else prediction.rest
    assert state[0] + shift == pytest.approx(7.0)


def test_filter_predicts_equation_noise_perfectly_but_for_the_noise_itself() -> None:
    """For ARX noise alone the best one-step predictor errs by v_k, no more."""
    process = EXAMPLE_1.process
    rng = np.random.default_rng(3)
    noise = rng.normal(0.0, 0.01, 400)
    stem = np.full(400, 50.0)
    pv = process.simulate(stem, noise=noise)
    tracker = StateFilter(Prediction.of(process), NoiseModel(1.0, 0.0, 1e-4))
    tracker.start(float(pv[0]), 50.0)
    errors = []
    for k in range(400):
        if k:
            tracker.advance(50.0)
        errors.append(tracker.correct(float(pv[k])))
    np.testing.assert_allclose(errors[200:], noise[200:], atol=2e-3)


def test_output_disturbance_on_an_integrator_is_refused() -> None:
    with pytest.raises(CompensatorError, match="input disturbance"):
        Prediction.of(PROCESSES[-1], "output")


@pytest.mark.parametrize(
    "process",
    [ProcessModel((-1.2,), (0.1,), 1, 0.0, 1.0), ProcessModel((-0.5,), (1.0, -1.0), 1, 0.0, 1.0)],
)
def test_processes_that_cannot_be_controlled_are_refused(process: ProcessModel) -> None:
    with pytest.raises(CompensatorError):
        Prediction.of(process)
