"""The compiled loops against independent implementations."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from estimator._kernels import fir, lag, stems
from loop_model import ValveModel


def test_stems_are_those_of_equation_4() -> None:
    rng = np.random.default_rng(1)
    op = np.cumsum(rng.normal(size=400))
    band, jump = np.array([1.0, 3.0, 5.0, 2.0]), np.array([0.0, 1.0, 5.0, 0.5])
    start = np.array([0.0, 0.5, -1.0, 0.3])
    found, moves = stems(op, band, jump, start)
    for i in range(band.size):
        expected = ValveModel(band[i], jump[i]).simulate(op, start[i])
        np.testing.assert_allclose(found[:, i], expected, atol=1e-12)
        changes = np.count_nonzero(np.diff(np.concatenate([[start[i]], expected])))
        assert moves[i] == changes


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
