"""The eliminated linear part against plain least squares."""

from __future__ import annotations

import numpy as np

from estimator.arx import ArxOrders, ArxRegression, select_orders
from estimator.regression import Regression, delayed
from estimator.structures import Structure
from loop_model import ProcessModel


def _window(n: int = 300) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    stem = np.repeat(rng.normal(size=n // 10), 10)
    y = rng.normal(size=n)
    good = rng.random(n) > 0.1
    return stem, np.where(good, y, 0.0), good


def test_simulation_cost_equals_least_squares() -> None:
    stem, y, good = _window()
    structure = Structure.of_time_constants(5.0, 2.0)
    regression = Regression(y, good)
    lags = (0, 3, 7)
    costs = regression.costs(stem[:, None], structure, lags)
    for i, d in enumerate(lags):
        response = delayed(structure.response(np.ascontiguousarray(stem[:, None])), d)
        design = np.hstack([response, structure.columns(y.size)])
        rows = regression.weight > 0
        _, rss, *_ = np.linalg.lstsq(design[rows], y[rows])
        np.testing.assert_allclose(costs[i, 0], rss[0], rtol=1e-9)


def test_arx_cost_and_gain_equal_least_squares() -> None:
    stem, y, good = _window()
    orders = ArxOrders(2, 3, 2)
    regression = ArxRegression(y, good, orders)
    cost, gain = regression.costs(np.ascontiguousarray(stem[:, None]))
    rows = np.flatnonzero(regression.weight)
    design = np.stack(
        [np.ones(rows.size)]
        + [y[rows - i] for i in (1, 2)]
        + [stem[rows - 2 - i] for i in range(3)],
        axis=1,
    )
    solution, rss, *_ = np.linalg.lstsq(design, y[rows])
    np.testing.assert_allclose(cost[0], rss[0], rtol=1e-7)
    expected = solution[3:].sum() / (1.0 - solution[1:3].sum())
    np.testing.assert_allclose(gain[0], expected, rtol=1e-5)


def test_orders_of_the_paper_s_process_are_found() -> None:
    # equation (18) of the paper
    process = ProcessModel((-2.091, 1.375, -0.2725), (0.002445, 0.007181, 0.001278), 1, 0.0, 1.0)
    rng = np.random.default_rng(6)
    stem = np.repeat(rng.normal(scale=5.0, size=100), 20)
    y = process.simulate(stem, noise=1e-3 * rng.normal(size=stem.size))
    best = select_orders(y, np.ones(y.size, dtype=bool), stem)[0]
    assert (best.na, best.nb, best.dead_time) == (3, 3, 1)
