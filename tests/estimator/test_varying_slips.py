"""A sticky valve whose slips are late and end off by chance."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from estimator.algebra import normal_equations
from estimator.evidence import varying_slips
from estimator.evidence.varying_slips import likelihood_of_varying_slips
from estimator.hypotheses.hypothesis import Valve
from estimator.hypotheses.noise import WHITE
from estimator.hypotheses.strokes import changes_of, strokes_of, varied_stem
from estimator.processes.poles import Poles, Shape
from tests.estimator.slipping import slip_by_chance
from tests.seeds import in_suite

Array = NDArray[np.float64]

STEM = np.array([5.0, 5.0, 7.0, 7.0, 7.0, 7.0, 4.0, 3.0, 3.0, 3.0, 3.0, 6.0, 6.0, 6.0])


def test_a_stroke_lasts_as_long_as_the_stem_moves_one_way() -> None:
    begins, ends = strokes_of(STEM)
    assert begins.tolist() == [2, 6, 11]
    assert ends.tolist() == [3, 8, 12]
    # a stem that turns without rest, and one that moves to the end
    begins, ends = strokes_of(np.array([0.0, 1.0, 2.0, 1.0, 0.0]))
    assert begins.tolist() == [1, 3]
    assert ends.tolist() == [3, 5]


def test_late_strokes_and_strokes_that_end_off() -> None:
    begins, ends = strokes_of(STEM)
    assert np.allclose(varied_stem(STEM, begins, ends, np.zeros(6)), STEM)
    late = varied_stem(STEM, begins, ends, np.array([1.0, -1.0, 0.25, 0.0, 0.0, 0.0]))
    assert np.allclose(late, [5, 5, 5, 7, 7, 4, 3, 3, 3, 3, 3, 5.25, 6, 6])
    off = varied_stem(STEM, begins, ends, np.array([0.0, 0.0, 0.0, 0.5, -0.5, 0.0]))
    assert np.allclose(off, [5, 5, 7.5, 7.5, 7.5, 7.5, 3.5, 2.5, 2.5, 2.5, 2.5, 6, 6, 6])


def test_changes_are_those_of_half_a_sample_either_way() -> None:
    begins, ends = strokes_of(STEM)
    at = np.array([0.3, -0.2, 0.6, 0.4, 0.0, -0.1])
    found = changes_of(STEM, begins, ends, at)
    for i, row in enumerate(found):
        half = np.where(np.arange(6) == i, 0.5, 0.0)
        more, less = (varied_stem(STEM, begins, ends, at + way * half) for way in (1.0, -1.0))
        assert np.allclose(row, more - less)


def test_strokes_of_chance_are_integrated_over() -> None:
    """The log of a normal density: noise plus slopes times numbers of these variances."""
    rng = np.random.default_rng(3)
    slopes = rng.normal(size=(6, 40))
    left = rng.normal(size=40) + 0.5 * rng.normal(size=6) @ slopes
    gram, pull = normal_equations(slopes, left)
    variances = np.array([0.2, 0.2, 0.2, 0.05, 0.05, 0.05])
    found, variance, worth = varying_slips._shrunk(
        gram, pull, float(left @ left), variances, (40.0, 0.0), 8
    )
    covariance = variance * np.eye(40) + slopes.T @ np.diag(variances) @ slopes
    density = multivariate_normal(np.zeros(40), covariance).logpdf(left)
    # less what all densities share, and the price of two deviations
    assert worth == pytest.approx(density + 20.0 * np.log(2.0 * np.pi) + 20.0 - np.log(40.0), 1e-3)
    expected = np.diag(variances) @ slopes @ np.linalg.solve(covariance, left)
    assert found == pytest.approx(expected, rel=1e-2, abs=1e-3)


def _window(spread: float, seed: int) -> tuple[Array, Array]:
    """OP and PV of a valve of S 5, J 3; when it slips, and where to, varies by a share of S."""
    rng = np.random.default_rng(seed)
    n = 700
    op = 50.0 + 6.0 * np.sin(np.arange(n) / 9.0 + 0.6 * np.sin(np.arange(n) / 50.0))
    stem = slip_by_chance(op, spread, rng)
    pv = lfilter([0.0, 0.12], [1.0, -0.88], stem - 50.0)
    return op, pv + 0.02 * rng.normal(size=n)


@pytest.mark.parametrize("seed", in_suite(1, [0, 1]))
def test_slips_that_vary_are_told_and_others_gain_nothing(case, seed: int) -> None:
    gained = []
    for spread in (0.0, 0.03):
        op, pv = _window(spread, seed)
        window = case(op, pv, signed=False)
        scale = float(window.rows.u.std() / op.std())
        valve = Valve(5.0 * scale, 3.0 * scale, float(window.rows.u[0]))
        plain = window.fit(valve, Poles(Shape.LAGS, 7.8), 0, (), WHITE)
        gained.append(likelihood_of_varying_slips(window, [plain]) - plain.likelihood)
    assert 0.0 <= gained[0] < 10.0
    assert gained[1] > 100.0
