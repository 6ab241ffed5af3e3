"""Sums over slips against plain least squares on signals."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.lanes import complete
from estimator._listing import list_sets, list_sets_at, sets_of
from estimator._one_step import one_step_costs
from estimator._response import least_squares
from estimator._simulated import simulated_costs, simulated_steps
from estimator._slips import Op, op_of
from estimator.arx import ArxFit, ArxOrders, ArxRegression, select_orders
from estimator.candidate import Candidate, stem_of
from estimator.exhaustive import _rows
from estimator.regression import Regression, delayed
from estimator.structures import Structure
from loop_model import ProcessModel

Window = tuple[Op, np.ndarray, np.ndarray]


def _window(n: int = 300) -> Window:
    """OP that wanders over one, PV that has nothing to do with it, a tenth of the samples bad."""
    rng = np.random.default_rng(5)
    u = np.cumsum(rng.normal(size=n))
    u = (u - u.mean()) / np.ptp(u)
    y = rng.normal(size=n)
    good = rng.random(n) > 0.1
    return op_of(u), np.where(good, y, 0.0), good


NODES = np.array([[0.3, 0.1, 0.2], [0.5, 0.4, 0.1], [0.2, 0.02, 0.15], [0.12, 0.12, 0.05]])
"""S, J, lead."""


@pytest.mark.parametrize("taps", [(1.0,), (1.0, -0.9, 0.2, 0.1)])
@pytest.mark.parametrize(
    "structure",
    [
        Structure(0.0, 0.0),
        Structure(0.6, 0.0),
        Structure.of_time_constants(5.0, 2.0),
        Structure(1.0, 0.0),
        Structure(1.0, 0.8),
    ],
)
@pytest.mark.parametrize("first", [1.0, -1.0])
def test_simulation_cost_equals_least_squares(
    structure: Structure, taps: tuple[float, ...], first: float
) -> None:
    op, y, good = _window()
    regression = Regression(y, good, np.array(taps))
    costs, gains = simulated_costs(op, regression.tables(structure), NODES, first, 0, 8)
    rows = regression.weight > 0
    for j, node in enumerate(NODES):
        stem = stem_of(op, *node, first)
        for d in (0, 3, 7):
            response = delayed(structure.response(stem), d)
            columns = np.vstack([response, structure.columns(y.size)])
            design = regression.weighted(columns)[:, rows].T
            solution, rss, *_ = np.linalg.lstsq(design, regression.weighted(y[None])[0, rows])
            np.testing.assert_allclose(costs[d, j], rss[0], rtol=1e-7)
            np.testing.assert_allclose(gains[d, j], solution[0], rtol=1e-5, atol=1e-7)


def test_least_squares_gives_a_row_that_others_span_no_share() -> None:
    rng = np.random.default_rng(5)
    rows, target = rng.normal(size=(4, 60)), rng.normal(size=60)
    shares, left = least_squares(rows, target)
    expected, rss, *_ = np.linalg.lstsq(rows.T, target)
    np.testing.assert_allclose(shares, expected, atol=1e-10)
    np.testing.assert_allclose(left @ left, rss[0])
    twice = np.vstack([rows, rows[1] - 2.0 * rows[3]])
    again, same = least_squares(twice, target)
    assert again[4] == 0.0
    np.testing.assert_allclose(again[:4], expected, atol=1e-10)
    np.testing.assert_allclose(same, left, atol=1e-10)


def test_simulation_cost_of_any_stem_is_that_of_its_steps() -> None:
    op, y, good = _window()
    regression, structure = Regression(y, good), Structure(0.8, 0.3)
    cost, gain = simulated_steps(
        regression.tables(structure), np.arange(1, y.size), np.diff(op.u), 2, 1
    )
    fit = regression.solve(op.u, structure, 2)
    np.testing.assert_allclose(cost[0], np.square(fit.residual).sum(), rtol=1e-9)
    np.testing.assert_allclose(gain[0], fit.gain, rtol=1e-7)


def _one_step_design(stem: np.ndarray, y: np.ndarray, orders: ArxOrders, rows: np.ndarray):
    past = [y[rows - i] for i in range(1, orders.na + 1)]
    stems = [stem[rows - orders.dead_time - i] for i in range(orders.nb)]
    return np.stack([np.ones(rows.size), *past, *stems], axis=1)


@pytest.mark.parametrize("orders", [ArxOrders(2, 1, 1), ArxOrders(1, 2, 4), ArxOrders(2, 3, 2)])
def test_arx_cost_and_gain_equal_least_squares(orders: ArxOrders) -> None:
    op, y, good = _window()
    regression = ArxRegression(y, good, orders)
    cost, gain = one_step_costs(op, regression.tables, NODES, 1.0)
    rows = np.flatnonzero(regression.weight)
    for j, node in enumerate(NODES):
        design = _one_step_design(stem_of(op, *node, 1.0), y, orders, rows)
        solution, rss, *_ = np.linalg.lstsq(design, y[rows])
        np.testing.assert_allclose(cost[j], rss[0], rtol=1e-7)
        past = solution[1 : 1 + orders.na]
        expected = solution[1 + orders.na :].sum() / (1.0 - past.sum())
        np.testing.assert_allclose(gain[j], expected, rtol=1e-5)


def test_the_listing_ranks_by_the_same_costs() -> None:
    op, y, good = _window()
    table = _rows(y, good, 6)
    # its rows begin at sample 8, so that every dead time has the same ones
    rows = np.flatnonzero(complete(good, 3))
    rows = rows[rows >= 8]
    for band, jump, lead in NODES[[0, 2, 3]]:  # the other one does not move in these rows
        # a region of one valve has one set of slips: its own
        region = np.array([[np.nextafter(band, 0.0), band, jump, jump]])
        valve = Candidate(0.0, band, jump, lead, 1.0, Structure(0.0, 0.0), 1).anchored(op)
        starts, least = np.array([[valve.lead, valve.first]]), np.zeros(2)
        listed = sets_of(0.1, 1.0, 6, 1)
        list_sets(op, table, region, starts, least, 1, listed)
        for d in range(1, 7):
            orders = ArxOrders(3, 2, d)
            design = _one_step_design(valve.stem(op), y, orders, rows)
            _, rss, *_ = np.linalg.lstsq(design, y[rows])
            np.testing.assert_allclose(listed.cost[:, d - 1].min(), rss[0], rtol=1e-4)
            followed = sets_of(0.1, 1.0, 6, 1)
            list_sets_at(op, table, np.array([d]), region, starts, least, 1, followed)
            np.testing.assert_allclose(followed.cost.min(), rss[0], rtol=1e-6)


def test_the_best_sets_of_each_stick_band_are_kept_in_order() -> None:
    op, y, good = _window()
    table = _rows(y, good, 3)
    region, starts = np.array([[0.1, 0.57, 0.05, 0.05]]), np.array([[0.05, 1.0]])
    many, few = sets_of(0.1, 0.6, 3, 500), sets_of(0.1, 0.6, 3, 4)
    for sets in (many, few):
        list_sets(op, table, region, starts, np.zeros(2), 10_000, sets)
    assert np.isfinite(many.cost).sum() > 3 * np.isfinite(few.cost).sum()
    np.testing.assert_array_equal(few.cost, np.sort(many.cost, axis=2)[:, :, :4])
    held = np.isfinite(few.cost)
    bins = np.broadcast_to(np.arange(few.cost.shape[0])[:, None, None], few.cost.shape)
    np.testing.assert_array_equal((few.region[held][:, 1] / 0.1).astype(int), bins[held])


def test_orders_of_the_paper_s_process_are_found() -> None:
    # equation (18) of the paper
    process = ProcessModel((-2.091, 1.375, -0.2725), (0.002445, 0.007181, 0.001278), 1, 0.0, 1.0)
    rng = np.random.default_rng(6)
    stem = np.repeat(rng.normal(scale=5.0, size=100), 20)
    y = process.simulate(stem, noise=1e-3 * rng.normal(size=stem.size))
    best = select_orders(y, np.ones(y.size, dtype=bool), stem)[0]
    assert (best.na, best.nb, best.dead_time) == (3, 3, 1)


def test_bic_of_orders_is_that_of_least_squares() -> None:
    op, y, good = _window()
    stem = stem_of(op, 0.3, 0.1, 0.2, 1.0)
    for orders in select_orders(y, good, stem):
        rows = np.flatnonzero(ArxRegression(y, good, ArxOrders(6, 3, 21)).weight)
        assert orders.rows == rows.size
        design = _one_step_design(stem, y, orders, rows)
        _, rss, *_ = np.linalg.lstsq(design, y[rows])
        free = design.shape[1] + 1
        bic = rows.size * np.log(rss[0] / rows.size) + free * np.log(rows.size)
        np.testing.assert_allclose(orders.bic, bic, rtol=1e-6)


def test_arx_simulates_as_its_process_model() -> None:
    fit = ArxFit(np.array([-1.2, 0.5]), np.array([0.3, 0.1]), 0.2, np.zeros(1))
    stem = np.repeat(np.random.default_rng(2).normal(size=20), 10)
    model = ProcessModel((-1.2, 0.5), (0.3, 0.1), 3, 0.2, 1.0)
    expected = model.simulate(stem, pv0=[0.4, -0.1])
    np.testing.assert_allclose(fit.simulate(stem, np.array([0.4, -0.1]), 3), expected, atol=1e-12)
