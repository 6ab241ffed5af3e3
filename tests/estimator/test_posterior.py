"""Intervals against facts that do not come from them: uniform laws, plain integration, coverage."""

from __future__ import annotations

import numpy as np
import pytest
from estimator._one_step import OneStep, one_step_costs
from estimator._slips import Op, first_slips, op_of, slips
from estimator.arx import ArxOrders, ArxRegression
from estimator.candidate import Candidate, stem_of
from estimator.listed import listed_posterior
from estimator.noise import errs_at_slips
from estimator.posterior import Posterior
from estimator.structures import COARSE
from estimator.zoomed import explore
from numpy.typing import NDArray
from scipy.stats import norm

Array = NDArray[np.float64]
BAND, JUMP = 0.5, 0.2


def _boxes(low: list[float], high: list[float], log: list[float]) -> Posterior:
    """Boxes in S; J from 0.1 to 0.2, the gain that of the box's number."""
    ends = np.array([low, [0.1] * len(low)]).T, np.array([high, [0.2] * len(low)]).T
    nodes = np.column_stack([0.5 * (ends[0] + ends[1]), np.zeros(len(low))])
    volume = np.prod(ends[1] - ends[0], axis=1)
    return Posterior(nodes, *ends, volume, np.array(log), np.arange(len(low), dtype=float))


def test_quantiles_of_one_box_are_those_of_a_uniform_law() -> None:
    s = _boxes([1.0], [2.0], [0.0]).interval(1.0, 0.0, 0.9)
    assert (s.low, s.value, s.high) == pytest.approx((1.05, 1.5, 1.95))


def test_blur_is_a_normal_law() -> None:
    s = _boxes([1.0], [1.0 + 1e-9], [0.0]).interval(1.0, 0.0, 0.9, blur=0.1)
    reach = 0.1 * norm.ppf(0.95)
    assert (s.low, s.value, s.high) == pytest.approx((1.0 - reach, 1.0, 1.0 + reach), abs=2e-3)


def test_an_interval_holds_both_of_two_likely_valves_and_names_them() -> None:
    # uniform in ln S, J / S and lead / S: a box at three times S counts a 27th
    two = _boxes([1.0, 3.0], [1.1, 3.1], [0.0, 2.0 * np.log((3.05 / 1.05) ** 3)])
    s = two.interval(1.0, 0.0, 0.9)
    assert (s.low, s.high) == pytest.approx((1.01, 3.09))
    assert [peak.share for peak in two.peaks()] == pytest.approx([0.5, 0.5])
    assert {peak.band for peak in two.peaks()} == {1.05, 3.05}
    apart = _boxes([1.0, 3.0], [1.1, 3.1], [0.0, -40.0])
    assert apart.interval(1.0, 0.0, 0.9).high < 1.1
    assert len(apart.peaks()) == 1


def test_dynamic_friction_is_half_the_difference() -> None:
    one = _boxes([1.0], [1.0 + 1e-9], [0.0])
    f = one.interval(0.5, -0.5, 0.9)
    assert (f.low, f.high) == pytest.approx((0.4025, 0.4475))


def _window(noise: float, n: int = 240) -> tuple[Op, Array, Candidate, ArxRegression]:
    """A wandering OP, a sticky valve and a first-order process with noise in its equation."""
    rng = np.random.default_rng(2)
    u = np.convolve(rng.normal(size=n + 20), np.ones(20) / 20.0, mode="valid")[:n]
    u = (u - u.mean()) / np.ptp(u)
    op = op_of(u)
    stem = stem_of(op, BAND, JUMP, 0.15, 1.0)
    y = np.zeros(n)
    for k in range(1, n):
        y[k] = 0.8 * y[k - 1] + 0.2 * stem[k - 1] + noise * rng.normal()
    regression = ArxRegression(y, np.ones(n, dtype=np.bool_), ArxOrders(1, 1, 1))
    best = Candidate(np.inf, BAND, JUMP, 0.15, 1.0, COARSE[0], 1).anchored(op)
    return op, y, best, regression


class _Likelihood:
    """Of ARX(1, 1) with errors of a known size while the window is not whole."""

    def __init__(self, y: Array, noise: float) -> None:
        self._y, self._noise = y, noise

    def tables(self, samples: int) -> OneStep:
        everything = np.ones(samples, dtype=np.bool_)
        return ArxRegression(self._y[:samples], everything, ArxOrders(1, 1, 1)).tables

    def log(self, samples: int, cost: Array) -> Array:
        if samples < self._y.size:
            return -0.5 * cost / self._noise**2
        return -0.5 * (samples - 1) * np.log(cost)


def test_listing_agrees_with_plain_integration() -> None:
    op, y, best, regression = _window(0.06)
    likelihood = _Likelihood(y, 0.06)
    listed = listed_posterior(op, likelihood, best)
    assert listed is not None
    rng = np.random.default_rng(0)
    low, high = 0.8 * best.band, 1.2 * best.band
    nodes = np.column_stack(
        [
            rng.uniform(low, high, 150_000),
            rng.uniform(0.0, high, 150_000),
            rng.uniform(best.lead - 0.06, best.lead + 0.06, 150_000),
        ]
    )
    cost, _ = one_step_costs(op, regression.tables, nodes, best.first)
    log = likelihood.log(y.size, cost)
    weight = np.exp(0.5 * (log - log[np.isfinite(log)].max())) / nodes[:, 0] ** 3
    for axis, found in enumerate(
        (listed.interval(1.0, 0.0, 0.9), listed.interval(0.0, 1.0, 0.9)),
    ):
        order = np.argsort(nodes[:, axis])
        share = np.cumsum(weight[order]) / weight.sum()
        plain = np.interp([0.05, 0.5, 0.95], share, nodes[order, axis])
        width = plain[2] - plain[0]
        assert np.abs(np.array([found.low, found.value, found.high]) - plain).max() < 0.2 * width


def test_first_slips_of_other_valves_are_listed_too() -> None:
    op, y, best, _ = _window(0.06)
    every = first_slips(op.u, best.first)
    far = every.of(best.lead) + 4
    low, high = float(every.feet[far]), float(every.feet[far] + every.gaps[far])

    def listed(*leads: float) -> bool:
        found = listed_posterior(op, _Likelihood(y, 0.06), best, leads)
        assert found is not None
        return bool(((low <= found.nodes[:, 2]) & (found.nodes[:, 2] <= high)).any())

    assert not listed()
    assert listed(float(every.leads[far]))


def test_zooming_agrees_with_listing() -> None:
    op, _, best, regression = _window(0.06)

    def evaluate(nodes: Array) -> tuple[Array, Array]:
        cost, gain = one_step_costs(op, regression.tables, nodes, best.first)
        return -0.5 * regression.count * np.log(cost), gain

    zoomed = explore(evaluate, best)
    s, j = zoomed.interval(1.0, 0.0, 0.9), zoomed.interval(0.0, 1.0, 0.9)
    assert BAND in s
    assert JUMP in j
    assert s.high - s.low < 0.3 * BAND


@pytest.mark.parametrize("extra", [0.0, 0.3])
def test_errors_that_follow_the_slips_are_seen(extra: float) -> None:
    rng = np.random.default_rng(1)
    op = op_of(np.sin(np.arange(1000) / 8.0))
    at, _ = slips(op, 1.0, 0.3, 0.2, 1.0)
    stem = stem_of(op, 1.0, 0.3, 0.2, 1.0)
    residual = rng.normal(scale=0.1, size=1000)
    residual[at + 2] += extra
    assert errs_at_slips(residual, np.ones(1000), stem, 1) is (extra > 0.0)
    assert not errs_at_slips(residual, np.ones(1000), np.zeros(1000), 1)
