"""The companion indices against cases whose answer is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal

from estimator.monitoring.indices import (
    HorchFinding,
    apparent_stiction,
    cross_correlation,
    harris_index,
    oscillation,
    valve_wear,
)
from estimator.monitoring.indices._signals import correlation
from estimator.outcomes import EstimatorError
from estimator.valves import HeValve

TIME = np.arange(1000.0)


@pytest.mark.parametrize("period", [12.0, 37.5, 90.0])
@pytest.mark.parametrize("shape", [np.sin, lambda p: np.sign(np.sin(p))])
def test_a_noisy_oscillation_has_its_period_and_is_regular(period, shape):
    rng = np.random.default_rng(0)
    values = 3.0 + 0.01 * TIME + shape(2 * np.pi * TIME / period) + rng.normal(0, 0.5, TIME.size)
    found = oscillation(values, period=10.0)
    assert found.is_regular
    assert found.period_s == pytest.approx(10.0 * period, rel=0.02)


@pytest.mark.parametrize("seed", range(10))
def test_noise_is_no_oscillation(seed):
    rng = np.random.default_rng(seed)
    assert not oscillation(rng.normal(size=800)).is_regular
    assert not oscillation(np.cumsum(rng.normal(size=800))).is_regular


def test_a_constant_is_no_oscillation():
    found = oscillation(np.full(100, 0.1))
    assert math.isnan(found.period_s)
    assert found.regularity == 0.0


@pytest.mark.parametrize(
    ("shift", "finding"),
    [
        (0.0, HorchFinding.NO_STICTION),
        (math.pi / 8, HorchFinding.NO_STICTION),
        (math.pi / 4, HorchFinding.UNDECIDED),
        (math.pi / 2.2, HorchFinding.STICTION),
        (math.pi / 2, HorchFinding.STICTION),
        (math.pi, HorchFinding.NO_STICTION),
    ],
)
def test_horch_reads_the_phase_shift(shift, finding):
    op = np.sin(2 * np.pi * TIME / 50.0)
    pv = np.sin(2 * np.pi * TIME / 50.0 - shift)
    assert cross_correlation(op, pv).finding is finding


def test_horch_measures_of_a_sinusoid():
    """For a phase shift p: lag asymmetry 2p/pi, height asymmetry (1 - cos p)/(1 + cos p)."""
    shift = math.pi / 5
    time = np.arange(20000.0)
    op = np.sin(2 * np.pi * time / 400.0)
    pv = np.sin(2 * np.pi * time / 400.0 - shift)
    found = cross_correlation(op, pv)
    assert found.lag_asymmetry == pytest.approx(2 * shift / math.pi, rel=0.01)
    expected = (1 - math.cos(shift)) / (1 + math.cos(shift))
    assert found.height_asymmetry == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("shift", [0.3, 1.0, math.pi / 2])
def test_apparent_stiction_of_an_ellipse_is_its_width(shift):
    rng = np.random.default_rng(1)
    op = 40.0 + 3.0 * np.sin(2 * np.pi * TIME / 40.0) + rng.normal(0, 0.1, TIME.size)
    pv = 100.0 + 7.0 * np.sin(2 * np.pi * TIME / 40.0 - shift)
    found = apparent_stiction(op, pv, period=2.0)
    assert found.apparent_stiction == pytest.approx(6.0 * math.sin(shift), rel=0.03)
    assert found.period_s == pytest.approx(80.0, rel=0.02)


def test_apparent_stiction_of_an_immediate_process_is_near_the_stick_band():
    """A valve without slip jump before a gain draws a parallelogram that is S wide."""
    op = 5.0 * np.sin(2 * np.pi * TIME / 100.0)
    pv = 2.0 * HeValve(4.0, 0.0).simulate(op)
    assert apparent_stiction(op, pv).apparent_stiction == pytest.approx(4.0, rel=0.2)


def test_no_ellipse_without_movement():
    assert math.isnan(apparent_stiction(np.ones(50), np.arange(50.0)).apparent_stiction)


@pytest.mark.parametrize(("coefficient", "dead_time"), [(0.5, 1), (0.9, 1), (0.9, 4)])
def test_harris_of_an_autoregression(coefficient, dead_time):
    """The d-step error of AR(1) has 1 - a^(2d) of its variance."""
    rng = np.random.default_rng(2)
    error = np.zeros(20000)
    for k in range(1, error.size):
        error[k] = coefficient * error[k - 1] + rng.normal()
    expected = 1.0 - coefficient ** (2 * dead_time)
    assert harris_index(error, dead_time=dead_time) == pytest.approx(expected, abs=0.03)


def test_harris_of_white_noise_is_one_and_bad_samples_do_not_matter():
    noise = np.random.default_rng(3).normal(size=2000)
    noise[::97] = np.nan
    assert harris_index(noise, dead_time=1, order=5) == pytest.approx(1.0, abs=0.02)
    assert math.isnan(harris_index(np.full(200, 0.3), dead_time=1))


def test_wear_counts_turns_beyond_the_dead_band():
    triangle = np.abs((np.arange(864) % 20) - 10.0)
    wear = valve_wear(triangle, period=100.0)  # 86,400 s: a day
    assert wear.travel_per_day == pytest.approx(863.0)
    assert wear.reversals_per_day == pytest.approx(86.0)
    noise = np.tile([0.0, 0.05], 432)
    assert valve_wear(noise, period=100.0, deadband=0.1).reversals_per_day == 0.0
    stepped = triangle + noise
    assert valve_wear(stepped, period=100.0, deadband=0.2).reversals_per_day == 86.0


def test_bad_samples_count_for_nothing():
    rng = np.random.default_rng(4)
    values = np.sin(2 * np.pi * TIME / 30.0)
    values[rng.random(TIME.size) < 0.1] = np.nan
    assert oscillation(values).period_s == pytest.approx(30.0, rel=0.02)


@pytest.mark.parametrize(
    ("call", "part"),
    [
        (lambda: oscillation(np.zeros((3, 3))), "shape"),
        (lambda: oscillation(np.full(50, np.nan)), "usable"),
        (lambda: cross_correlation(np.zeros(30), np.zeros(31)), "one length"),
        (lambda: harris_index(np.zeros(100), dead_time=0), "dead_time"),
        (lambda: harris_index(np.arange(60.0), dead_time=1, order=20), "order"),
        (lambda: valve_wear(np.zeros(30), period=0.0), "period"),
        (lambda: oscillation([math.inf] * 30), "infinity"),
    ],
)
def test_bad_input_is_refused_with_its_name(call, part):
    with pytest.raises(EstimatorError, match=part):
        call()


@pytest.mark.parametrize("samples", [20, 63, 1237])
def test_the_correlation_is_that_of_scipy_to_the_last_bit(samples: int) -> None:
    u, y = np.random.default_rng(samples).standard_normal((2, samples))
    lags, found = correlation(u, y)
    wanted = signal.correlate(y, u, method="fft") / np.sqrt(np.dot(u, u) * np.dot(y, y))
    assert np.array_equal(found, wanted)
    assert np.array_equal(lags, signal.correlation_lags(samples, samples))
