"""The Riccati equation: against closed forms, SciPy and itself, dead times and all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are

from compensator import CompensatorError
from compensator.prediction import NoiseModel, Prediction
from compensator.riccati import solve_riccati
from fieldlink.lab.study.closed_loop import EXAMPLE_1, EXAMPLE_2
from loop_model import ProcessModel

Array = np.ndarray


def _left_over(A: Array, b: Array, Q: Array, r: float, X: Array) -> float:
    """How far ``X`` is from solving the equation, relative to itself."""
    moved = A.T @ X @ b
    found = A.T @ X @ A - np.outer(moved, moved) / (r + b @ X @ b) + Q
    return float(np.abs(X - found).max() / np.abs(X).max())


@pytest.mark.parametrize("pole", [0.0, 0.5, 0.999, 1.0, 1.3])
@pytest.mark.parametrize("price", [1e-6, 1.0, 1e6])
def test_one_state_has_the_root_of_a_quadratic(pole: float, price: float) -> None:
    found = solve_riccati(np.array([[pole]]), np.ones(1), np.ones((1, 1)), price)
    # x^2 + x (price - pole^2 price - 1) - price = 0
    middle = price - pole**2 * price - 1.0
    expected = max(np.roots([1.0, middle, -price]))
    assert found[0, 0] == pytest.approx(expected, rel=1e-6)


@settings(max_examples=25)  # dead times of up to 200 samples take a second each
@given(
    poles=st.lists(st.floats(0.0, 0.995), min_size=1, max_size=2),
    dead_time=st.integers(1, 200),
    weight=st.floats(-6.0, 4.0).map(lambda power: 10.0**power),
)
def test_every_dead_time_and_price_is_solved(
    poles: list[float], dead_time: int, weight: float
) -> None:
    a = np.poly(poles)
    p = Prediction.of(ProcessModel(tuple(a[1:]), (1.0, 0.5), dead_time, 0.0, 1.0))
    stage = np.zeros((p.order, p.order))
    stage[0, 0] = 1.0
    found = solve_riccati(p.A, p.B, stage, weight * p.scale**2)
    assert _left_over(p.A, p.B, stage, weight * p.scale**2, found) < 1e-9
    assert np.linalg.eigvalsh(found).min() > -1e-9 * np.abs(found).max()


def test_the_last_digit_of_a_process_decides_nothing() -> None:
    # SciPy's ordering of eigenvalues fails for one in a hundred of these
    rng = np.random.default_rng(1)
    p = Prediction.of(EXAMPLE_2.process)
    stage = np.diag([1.0] + [0.0] * (p.order - 1))
    found = []
    for _ in range(300):
        A, b = (M * (1.0 + 2e-16 * rng.integers(-2, 3, M.shape)) for M in (p.A, p.B))
        found.append(solve_riccati(A, b, stage, 1.5 * p.scale**2))
    assert np.ptp(found, axis=0).max() < 1e-9 * np.abs(found).max()


@pytest.mark.parametrize("process", [EXAMPLE_1.process, EXAMPLE_2.process])
def test_filter_with_correlated_noise_is_scipys(process: ProcessModel) -> None:
    p = Prediction.of(replace(process, dead_time=3))
    n, noise = p.order, NoiseModel(0.3, 1.0, 0.2)
    A = np.block([[p.A, np.zeros((n, 1))], [np.zeros((1, n)), np.ones((1, 1))]])
    C = np.zeros((1, n + 1))
    C[0, 0] = C[0, n] = 1.0
    enters = np.append(p.equation_gain, 0.0)[:, None]
    q = noise.equation**2 * enters @ enters.T
    q[n, n] += noise.disturbance**2
    r, s = noise.equation**2 + noise.measurement**2, noise.equation**2 * enters
    covariance = solve_discrete_are(A.T, C.T, q, np.array([[r]]), s=s)
    innovation = (C @ covariance @ C.T).item() + r
    expected = ((A @ covariance @ C.T + s) / innovation)[:, 0]
    state, disturbance, variance = p.filter_gain(noise)
    np.testing.assert_allclose([*state, *disturbance], expected, rtol=1e-6, atol=1e-8)
    assert variance == pytest.approx(innovation, rel=1e-6)


@pytest.mark.parametrize(
    ("A", "b", "seen"),
    [([[1.2]], [0.0], 1.0), ([[1.0]], [0.0], 1.0)],
    ids=["unstable and not moved", "integrating and not moved"],
)
def test_what_has_no_solution_is_said(A: list, b: list, seen: float) -> None:
    with pytest.raises(CompensatorError, match="not moved"):
        solve_riccati(np.array(A), np.array(b), np.array([[seen]]), 1.0)
