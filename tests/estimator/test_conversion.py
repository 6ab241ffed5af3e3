"""The process in plant units simulates what the hypothesis simulates in scaled ones."""

from __future__ import annotations

import numpy as np
import pytest

from estimator import identify
from estimator.criteria.conversion import process_model
from estimator.hypotheses.linear_fit import delay, fit_linear
from estimator.processes.poles import Poles, Shape
from estimator.rows import rows_of
from estimator.settings import SETTINGS
from estimator.window import harmonise
from loop_model import ProcessModel, ValveModel
from tests.seeds import few_and_all, in_suite

N = 240
CASES = (
    Poles(Shape.LAGS, 0.0),
    Poles(Shape.LAGS, 6.0),
    Poles(Shape.LAGS, 9.0, 2.0, 0.7),
    Poles(Shape.SWINGING, 18.0, 0.4),
    Poles(Shape.INTEGRATING, 0.0),
    Poles(Shape.INTEGRATING, 0.0, 3.0),
)


@pytest.mark.parametrize("dead_time", [0, 4])
@pytest.mark.parametrize("poles", CASES, ids=str)
def test_the_arx_form_simulates_what_the_hypothesis_does(poles: Poles, dead_time: int) -> None:
    rng = np.random.default_rng(3)
    op = 40.0 + 12.0 * np.repeat(rng.normal(size=N // 8), 8)
    pv = 300.0 - 7.0 * rng.normal(size=N)
    window = harmonise(op, pv, None, None, 2.0, SETTINGS.screening)
    rows = rows_of(window, 0.0, SETTINGS.modelling)
    stem = ValveModel(0.2, 0.1).simulate(window.u, float(window.u[0]))
    columns = rows.columns(integrating=poles.integrating)
    fit = fit_linear(rows, poles.response(stem), dead_time, columns, np.zeros(0))
    model = process_model(window, poles, dead_time, fit, float(stem[0]))
    # without the column that dies away after the window's start, which is not the process
    late = poles.response(stem)
    scaled = fit.gains[0] * delay(late, dead_time) + fit.gains[1] * delay(late, dead_time + 1)
    scaled = scaled + fit.columns[0]
    if poles.integrating:
        scaled = scaled + fit.columns[2] * np.arange(N) / N
    expected = window.pv_centre + window.pv_scale * scaled
    memory = 12
    if poles.integrating:
        # the line was going on before the window: its past starts the model
        before = expected[:memory]
        plant = (window.op_centre + window.op_span * stem)[memory - model.dead_time - 2 :]
        found = _continued(model, plant, before, model.dead_time + 2)
        np.testing.assert_allclose(found, expected[memory:], atol=1e-6 * window.pv_scale)
    else:
        found = model.simulate(window.op_centre + window.op_span * stem)
        np.testing.assert_allclose(found, expected, atol=1e-6 * window.pv_scale)
    assert model.period == 2.0


def _continued(model: ProcessModel, stem: np.ndarray, before: np.ndarray, known: int) -> np.ndarray:
    """PV by equation (7) written out, from the PV before; ``known`` samples of stem are past."""
    pv = list(before)
    for k in range(known, stem.size):
        value = model.offset
        value -= sum(a * pv[-1 - i] for i, a in enumerate(model.a))
        value += sum(b * stem[k - model.dead_time - i] for i, b in enumerate(model.b))
        pv.append(value)
    return np.array(pv[before.size :])


@pytest.mark.parametrize("integrating", in_suite(1, [True, False]))
@pytest.mark.parametrize("seeds", few_and_all(5, range(20)))
def test_the_model_for_the_controller_simulates_the_loop(loop, integrating, seeds) -> None:
    """From the true stem, which nobody measures; what is wrong with the valve, an integrator sums.

    An integrating process shows a wrong first position of the stem: the valve then slips at other
    samples all through the window.
    """
    left = []
    for seed in seeds:
        op, pv, stem = loop(ValveModel(5.0, 2.0), samples=500, integrating=integrating, seed=seed)
        model = identify(op, pv).model
        assert model is not None
        error = model.process.simulate(stem, pv0=pv[:3]) - pv
        left.append(float(np.std(error[100:]) / np.std(pv)))
    assert np.median(left) < 0.15
    # at one set-point J trades against the gain, and that error passes on
    assert max(left) < 0.4
