"""The compiled loops against independent implementations."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from estimator.lanes import complete, lag, weighted


def test_lag_is_a_first_order_filter_started_at_rest() -> None:
    signal = np.random.default_rng(2).normal(size=200)
    pole = 0.8
    expected, _ = lfilter([1 - pole], [1, -pole], signal, zi=pole * signal[:1])
    np.testing.assert_allclose(lag(signal, pole), expected, atol=1e-12)


def test_lag_with_pole_one_integrates() -> None:
    signal = np.random.default_rng(2).normal(size=200)
    np.testing.assert_allclose(lag(signal, 1.0), np.cumsum(signal) / 200.0, atol=1e-12)


def test_a_noise_filter_is_a_convolution_with_the_first_value_before_it() -> None:
    rng = np.random.default_rng(3)
    rows, weight = rng.normal(size=(2, 100)), rng.random(100)
    taps = np.array([1.0, -0.7, 0.2])
    before = np.hstack([np.repeat(rows[:, :1], 2, axis=1), rows])
    expected = lfilter(taps, [1.0], before, axis=1)[:, 2:] * weight
    np.testing.assert_allclose(weighted(rows, taps, weight), expected, atol=1e-12)


def test_a_sample_is_complete_when_all_its_past_is_good() -> None:
    good = np.array([True, True, False, True, True, True, True])
    expected = [all(good[max(0, k - 2) : k + 1]) for k in range(good.size)]
    assert complete(good, 2).tolist() == expected
