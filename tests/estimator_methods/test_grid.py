"""The paper's grid search and its criterion."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.outcomes import EstimatorError
from estimator.published.grid import grid_search
from estimator.published.paper_fit import ArxStructure, ArxWindow, InitialStem
from estimator.valves import HeValve
from loop_model import ProcessModel


def _clean_window(loop):
    """Start where the stem has just moved, so that the truth lies within the grid's reach."""
    stem = loop.valve.simulate(loop.op, float(loop.op[0]))
    pv = loop.process.simulate(stem)
    return loop.op, pv


def test_truth_on_the_grid_is_found_with_its_process(sticky_loop):
    op, pv = _clean_window(sticky_loop)
    fit = grid_search(op, pv, na=2, nb=2, step=0.5)
    assert (fit.static_friction, fit.dynamic_friction) == (3.0, 1.5)
    assert fit.cost == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(fit.process.a, sticky_loop.process.a, atol=1e-6)
    np.testing.assert_allclose(fit.process.b, sticky_loop.process.b, atol=1e-6)


def test_smoothed_and_he_valves_agree_at_tau_1e4(sticky_loop):
    smooth = grid_search(sticky_loop.op, sticky_loop.pv, na=2, nb=2, step=0.5)
    exact = grid_search(sticky_loop.op, sticky_loop.pv, na=2, nb=2, step=0.5, tau=None)
    assert (smooth.static_friction, smooth.dynamic_friction) == (
        exact.static_friction,
        exact.dynamic_friction,
    )
    assert smooth.cost == pytest.approx(exact.cost, rel=1e-6)


def test_every_returned_stem_moves_enough(sticky_loop):
    fit = grid_search(sticky_loop.op, sticky_loop.pv, na=2, nb=2, step=0.5, alpha=0.5)
    assert fit.stem.var() >= 0.5 * sticky_loop.op.var()


def test_cost_is_half_the_squared_error_of_the_prediction(sticky_loop):
    window = ArxWindow.of(sticky_loop.op, sticky_loop.pv, ArxStructure(2, 2))
    fit = window.fit(HeValve(4.5, 1.5), float(sticky_loop.op[0]))
    error = (sticky_loop.pv - fit.pv_model)[2:]
    assert fit.cost == pytest.approx(0.5 * np.sum(error**2))


@pytest.mark.parametrize("dead_time", [0, 1, 3])
def test_prediction_follows_the_conventions_of_the_process_model(sticky_loop, dead_time):
    process = ProcessModel((-0.8,), (0.3, 0.1), dead_time, 2.0, 1.0)
    stem = HeValve(4.5, 1.5).simulate(sticky_loop.op, 0.0)
    pv = process.simulate(stem)
    window = ArxWindow.of(sticky_loop.op, pv, ArxStructure(1, 2, dead_time))
    theta, cost = window.solve(stem)
    assert cost == pytest.approx(0.0, abs=1e-15)
    assert window.process(theta).b == pytest.approx(process.b)
    assert window.process(theta).offset == pytest.approx(2.0)


def test_initial_stem_is_first_or_mean(sticky_loop):
    assert InitialStem("first").position(sticky_loop.op) == sticky_loop.op[0]
    assert InitialStem("mean").position(sticky_loop.op) == pytest.approx(sticky_loop.op.mean())


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"step": 0.0}, "step"),
        ({"na": -1}, "na"),
        ({"op": np.zeros(50), "pv": np.zeros(50)}, "constant"),
        ({"op": np.ones(9), "pv": np.ones(8)}, "shapes"),
        ({"op": np.arange(9.0), "pv": np.ones(9)}, "samples"),
        ({"op": np.r_[np.nan, np.arange(49.0)], "pv": np.ones(50)}, "first at 0"),
    ],
)
def test_bad_input_is_refused_with_its_name(sticky_loop, change, part):
    arguments = {"op": sticky_loop.op, "pv": sticky_loop.pv, "na": 2, "nb": 2, "step": 1.0}
    with pytest.raises(EstimatorError, match=part):
        grid_search(**(arguments | change))
