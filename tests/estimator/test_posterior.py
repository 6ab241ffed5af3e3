"""Intervals against facts that do not come from them: normal laws and plain integration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from estimator import identify
from estimator.hypotheses.gain import pole_derivatives
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.hypotheses.linear_fit import fit_linear
from estimator.intervals.posterior import EXACT, Gap, Posterior, gap_of_no_law, sample_posterior
from estimator.processes.poles import Poles, Shape
from estimator.search.processes import spread_points
from estimator.settings import SETTINGS
from loop_model import ValveModel

Array = NDArray[np.float64]
CaseOf = Callable[..., Case]


def _normal(count: int = 4000) -> Posterior:
    """Samples of S = 1 + 0.1 a, J = 0.5 + 0.06 a + 0.08 b with a, b of a standard normal law."""
    rng = np.random.default_rng(0)
    wide = 2.0 * rng.normal(size=(count, 2))  # drawn too wide, weighted back
    weight = np.exp(-0.5 * np.square(wide).sum(axis=1) + 0.125 * np.square(wide).sum(axis=1))
    band = 1.0 + 0.1 * wide[:, 0]
    jump = 0.5 + 0.06 * wide[:, 0] + 0.08 * wide[:, 1]
    samples = np.column_stack([band, jump, np.zeros(count)])
    return Posterior(samples, weight / weight.sum())


@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.99])
@pytest.mark.parametrize(
    ("of_band", "of_jump", "centre", "spread"),
    [
        (1.0, 0.0, 1.0, 0.1),
        (0.0, 1.0, 0.5, 0.1),
        (0.5, 0.5, 0.75, np.hypot(0.08, 0.04)),
        (0.5, -0.5, 0.25, np.hypot(0.02, 0.04)),
    ],
    ids=["S", "J", "fS", "fD"],
)
def test_an_interval_of_weighted_normal_samples_has_the_normal_law_s_ends(
    of_band: float, of_jump: float, centre: float, spread: float, confidence: float
) -> None:
    found = _normal().interval(of_band, of_jump, confidence)
    reach = spread * norm.ppf(0.5 + 0.5 * confidence)
    ends = (found.low, found.value, found.high)
    expected = (centre - reach, centre, centre + reach)
    np.testing.assert_allclose(ends, expected, atol=0.12 * spread)


def test_a_gap_adds_a_normal_law() -> None:
    plain = _normal()
    wide = replace(plain, gaps=(Gap(1.0, 0.3, 0.3, 0.0),))
    found = wide.interval(1.0, 0.0, 0.9)
    reach = np.hypot(0.3, 0.1) * norm.ppf(0.95)
    np.testing.assert_allclose((found.low, found.high), (1.0 - reach, 1.0 + reach), atol=0.15 * 0.3)
    assert wide.interval(0.0, 1.0, 0.9) == plain.interval(0.0, 1.0, 0.9)
    upwards = replace(plain, gaps=(Gap(1.0, 0.0, 0.3, 0.0),)).interval(1.0, 0.0, 0.9)
    assert upwards.high == pytest.approx(found.high, abs=0.1)
    assert upwards.low > 1.0 - 0.1 * norm.ppf(0.95) - 0.02


@pytest.mark.parametrize("share", [0.02, 0.2, 0.6])
def test_an_interval_under_one_of_two_gaps_has_the_ends_of_the_mixture(share: float) -> None:
    plain, wide = _normal(), 0.5
    gaps = (Gap(1.0 - share, 0.0, 0.0, 0.0), Gap(share, wide, wide, 0.0))
    found = replace(plain, gaps=gaps).interval(1.0, 0.0, 0.9)
    away = np.linspace(0.0, 2.0, 20001)
    beyond = (1.0 - share) * norm.sf(away / 0.1) + share * norm.sf(away / np.hypot(0.1, wide))
    reach = away[np.argmax(beyond < 0.05)]
    assert found.high - 1.0 == pytest.approx(reach, rel=0.15)
    assert 1.0 - found.low == pytest.approx(reach, rel=0.15)


def test_upwards_a_gap_ends_where_op_s_span_does() -> None:
    # OP that moved the stem both ways moved farther than S
    spreading = SETTINGS.spreading
    gaps = [gap_of_no_law(spreading, band, 0.0) for band in (0.1, 0.5, 0.9, 1.1)]
    room = [gap.above / gap.below for gap in gaps]
    assert room == sorted(room, reverse=True)
    assert 0.9 + norm.ppf(0.95) * gaps[2].above < 1.0
    assert gaps[3].above == 0.0


def test_two_likely_valves_are_both_in_the_interval_and_named() -> None:
    samples = np.array([[1.0, 0.2, 0.0], [1.01, 0.2, 0.0], [3.0, 0.4, 0.0]])
    two = Posterior(samples, np.array([0.3, 0.3, 0.4]))
    found = two.interval(1.0, 0.0, 0.9)
    assert found.low <= 1.01
    assert found.high == 3.0
    assert [(peak.band, peak.jump) for peak in two.peaks()] == [(1.0, 0.2), (3.0, 0.4)]
    assert [peak.share for peak in two.peaks()] == pytest.approx([0.6, 0.4])
    alone = Posterior(samples, np.array([0.5, 0.49, 0.01]))
    assert len(alone.peaks()) == 1


@pytest.mark.parametrize("dimensions", [1, 3, 5])
def test_even_points_have_the_moments_of_a_normal_law(dimensions: int) -> None:
    points = spread_points(600, dimensions)
    np.testing.assert_array_equal(points[0], np.zeros(dimensions))
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=0.04)
    np.testing.assert_allclose(points.T @ points / 600, np.eye(dimensions), atol=0.1)


@pytest.fixture(scope="module")
def known(case: CaseOf) -> tuple[Case, Hypothesis]:
    """A wandering OP behind a sliding valve: its stem is continuous in S and J."""
    rng = np.random.default_rng(4)
    op = np.cumsum(np.sin(np.arange(400) / 11.0) + 0.3 * rng.normal(size=400))
    op = (op - 0.5 * (op.max() + op.min())) / np.ptp(op)
    valve = Valve(0.3, 0.15, float(op[0]), "sliding")
    poles = Poles(Shape.LAGS, 4.0)
    pv = poles.response(valve.stem(op)) + 0.04 * rng.normal(size=400)
    window = case(op, pv, signed=False)
    return window, window.fit(valve, poles, 0, (), np.zeros(0))


def test_samples_of_the_posterior_agree_with_plain_integration(known) -> None:
    # uniform in log S, J / S and start / S; gain, columns and poles (to first order) are solved for
    window, best = known
    # without what the law itself leaves open
    posterior = replace(sample_posterior(window, (best,)), gaps=(EXACT,))
    rng, count = np.random.default_rng(1), 6000
    band = 0.3 * np.exp(rng.uniform(-0.25, 0.25, count))
    jump, start = band * rng.random(count), best.valve.start + band * rng.uniform(-1.0, 1.0, count)
    columns = np.vstack([window.columns((), best.stem, best.poles, 0), pole_derivatives(best)])
    log = np.empty(count)
    for i in range(count):
        stem = Valve(band[i], jump[i], start[i], "sliding").stem(window.rows.u)
        response = best.poles.response(stem)
        fits = [fit_linear(window.rows, response, d, columns, best.taps) for d in range(3)]
        log[i] = window.log_likelihood(min(fit.squares for fit in fits))
    weight = np.exp(window.settings.spreading.temper * (log - log.max()))
    for found, values in (
        (posterior.interval(1.0, 0.0, 0.9), band),
        (posterior.interval(0.0, 1.0, 0.9), jump),
    ):
        order = np.argsort(values)
        share = np.cumsum(weight[order]) / weight.sum()
        low, middle, high = np.interp([0.05, 0.5, 0.95], share, values[order])
        ends = (found.low, found.value, found.high)
        np.testing.assert_allclose(ends, (low, middle, high), atol=0.25 * (high - low))


@pytest.mark.parametrize("confidence", [0.6, 0.95])
def test_the_true_valve_is_in_its_interval(loop, confidence: float) -> None:
    op, pv, _ = loop(ValveModel(5.0, 2.0), samples=500, noise=0.3, seed=7)
    found = identify(op, pv, confidence=confidence)
    assert found.stick_band.low <= found.stick_band.value <= found.stick_band.high
    assert 5.0 in found.stick_band
    assert found.stick_band.high - found.stick_band.low < 1.5
