"""A load that swings to and fro, no two swings alike, is not taken for a sticky valve."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from estimator import Verdict, identify
from estimator.evidence.turns_by_chance import precision_of, price_of_turns, spread_of
from estimator.hypotheses.uneven_wave import UnevenWave, course_of, slopes_of
from estimator.processes.poles import Poles, Shape
from tests.closed_loop import run

Array = NDArray[np.float64]

STRAIGHT = np.zeros((2, 0))
TIMES = np.array([-7.5, 20.2, 51.1, 88.8, 120.3])
HEIGHTS = np.array([1.0, -2.0, 1.5, -1.0, 2.0])


def uneven_wave(n: int, period: float, rise: float, seed: int) -> Array:
    """A wave of straight lines whose lengths and heights differ by about a tenth."""
    rng = np.random.default_rng(seed)
    count = 2 * int(n / period) + 8
    shares = np.where(np.arange(count) % 2 == 0, rise, 1.0 - rise)
    turns = np.cumsum(period * shares * (1.0 + 0.1 * rng.standard_normal(count))) - period
    heights = np.where(np.arange(count) % 2 == 0, -1.0, 1.0) * (
        1.0 + 0.08 * rng.standard_normal(count)
    )
    return np.interp(np.arange(n), turns, heights)


def test_without_bends_it_is_drawn_in_straight_lines_from_turn_to_turn() -> None:
    times, heights = TIMES, HEIGHTS
    drawn = np.interp(np.arange(100.0), times, heights)
    np.testing.assert_allclose(course_of(100, times, heights, STRAIGHT), drawn, atol=1e-12)
    wave = UnevenWave(tuple(times), tuple(heights), ((), ()), None, 3.0)
    column = wave.columns(np.zeros(100), Poles(Shape.LAGS, 6.0), 0)
    np.testing.assert_allclose(column[0], drawn / np.abs(drawn).max(), atol=1e-12)


def test_its_slopes_are_the_differences_of_its_course() -> None:
    times, heights = TIMES, HEIGHTS
    bends = np.array([[0.1, -0.1], [-0.05, 0.2]])

    def course(numbers: Array) -> Array:
        return course_of(100, numbers[:5], numbers[5:10], numbers[10:].reshape(-1, 2).T)

    at = np.concatenate([times, heights, bends.T.ravel()])
    slopes = slopes_of(times, heights, bends, 100)
    for i, step in enumerate(1e-6 * np.eye(at.size)):
        differences = (course(at + step) - course(at - step)) / 2e-6
        np.testing.assert_allclose(slopes[i], differences, atol=1e-6)


def test_what_turns_cost_is_what_the_likelihood_loses_when_it_is_integrated_over_them() -> None:
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.normal(30.0, 2.0, 8))
    heights = np.where(np.arange(8) % 2 == 0, 1.0, -1.0) + 0.1 * rng.standard_normal(8)
    spread = spread_of(times, heights, np.zeros((16, 16)))
    precision, mean = precision_of(spread, times[0], 8, 0)
    # a linear window of unit noise, in which Laplace's approximation is exact
    slopes, middle = rng.normal(size=(16, 40)), np.linalg.solve(precision, mean)
    seen = slopes.T @ np.concatenate([times, heights]) + rng.standard_normal(40)
    told = slopes @ slopes.T
    at = np.linalg.solve(told + precision, slopes @ seen + mean)
    most = multivariate_normal(slopes.T @ at, np.eye(40)).logpdf(seen)
    spread_seen = np.eye(40) + slopes.T @ np.linalg.inv(precision) @ slopes
    integrated = multivariate_normal(slopes.T @ middle, spread_seen).logpdf(seen)
    # seven numbers of the distributions at half a log of the rows
    cost = price_of_turns(at, told, precision, mean, 40.0) - 3.5 * np.log(40.0)
    assert cost == pytest.approx(most - integrated, abs=1e-6)


def test_healthy_valves_under_an_uneven_saw_tooth_are_not_accused() -> None:
    """Three of these four were, when a load of steps and lines was the only rival."""
    accused = 0
    for seed in (1, 3, 4, 7):
        load = 4.0 * uneven_wave(900, 80.0, 0.05, seed)
        record = run(load=load, n=900, noise=0.05, gain=0.5, seed=seed)
        accused += identify(record.op, record.pv, sp=record.sp).verdict is Verdict.STICTION
    assert accused <= 1


def test_sticky_valves_under_an_uneven_saw_tooth_are_found() -> None:
    found = 0
    for seed in range(1, 5):
        load = 2.0 * uneven_wave(900, 80.0, 0.05, seed)
        record = run(load=load, n=900, band=6.0, jump=3.0, noise=0.05, gain=0.8, seed=seed)
        found += identify(record.op, record.pv, sp=record.sp).verdict is Verdict.STICTION
    assert found >= 3
