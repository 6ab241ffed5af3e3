"""The compiled loops against independent implementations."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from estimator._kernels import complete, fir, lag


def test_lag_is_a_first_order_filter_started_at_rest() -> None:
    signal = np.random.default_rng(2).normal(size=(200, 3))
    pole = 0.8
    expected, _ = lfilter([1 - pole], [1, -pole], signal, axis=0, zi=pole * signal[:1])
    np.testing.assert_allclose(lag(signal, pole), expected, atol=1e-12)


def test_lag_with_pole_one_integrates() -> None:
    signal = np.random.default_rng(2).normal(size=(200, 3))
    np.testing.assert_allclose(lag(signal, 1.0), np.cumsum(signal, axis=0) / 200.0, atol=1e-12)


def test_fir_is_a_convolution() -> None:
    signal = np.random.default_rng(3).normal(size=(100, 2))
    taps = np.array([1.0, -0.7, 0.2])
    expected = lfilter(taps, [1.0], signal, axis=0)
    np.testing.assert_allclose(fir(signal, taps)[2:], expected[2:], atol=1e-12)


def test_a_sample_is_complete_when_all_its_past_is_good() -> None:
    good = np.array([True, True, False, True, True, True, True])
    expected = [all(good[max(0, k - 2) : k + 1]) for k in range(good.size)]
    assert complete(good, 2).tolist() == expected
