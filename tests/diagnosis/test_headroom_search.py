"""The compiled search takes the steps of SciPy's simplex, and a power ends where it is complete."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.signal import lfilter

from estimator.diagnosis.headroom_search import Kind, fit_numbers, least_numbers
from estimator.diagnosis.innovations import poles_product, power_of_load

BOUNDS = (25, 60, 18.0)
JUMPS = np.array([70, 130], dtype=np.int64)
"""Samples that do not count."""


@pytest.mark.parametrize("tries", [3, 20, 21, 22, 120])
@pytest.mark.parametrize(
    "kind", [(1, False, False, 0.3), (1, False, True, 0.0), (2, True, False, 0.0)]
)
def test_the_search_is_that_of_scipy(kind: Kind, tries: int) -> None:
    rng = np.random.default_rng(tries)
    n = 300
    u = np.cumsum(rng.normal(size=n))
    y = lfilter([0.0, 0.0, 0.2], [1.0, -0.8], u) + np.cumsum(rng.normal(size=n))
    _, behind, integrating, _ = kind
    has = np.array([not integrating, not behind, True, True])
    start, reach = np.log([10.0, 0.1, 25.0, 0.02])[has], np.array([0.8, 2.0, 0.8, 2.0])[has]
    corners = start + np.vstack([np.zeros(start.size), np.diag(reach)])

    def cost(numbers: np.ndarray) -> float:
        if np.abs(numbers).max() > BOUNDS[2]:
            return 1e12
        squares = fit_numbers(numbers, kind, y, u, BOUNDS, JUMPS)[0]
        count = n - 60 - JUMPS.size
        return float(0.5 * count * np.log(squares.min() / count))

    expected = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={"maxfev": tries, "initial_simplex": corners, "xatol": 0.03, "fatol": 0.1},
    )
    found = least_numbers(corners, kind, y, u, BOUNDS, JUMPS, tries)
    np.testing.assert_allclose(found, expected.x, rtol=1e-9)


def test_a_power_lacks_nothing_of_the_samples_it_leaves_out() -> None:
    rng = np.random.default_rng(3)
    for count in (1, 2, 3) * 40:
        # time constants of a third of a sample to 10,000
        poles = np.exp(-np.exp(-rng.uniform(-1.0, 9.0, count)))
        bottom = poles_product(poles)
        assert power_of_load(bottom) == _power_of_every_sample([float(v) for v in bottom[1:]])


def _power_of_every_sample(bottom: list[float]) -> float:
    past, total = [0.0] * len(bottom), 0.0
    for k in range(2000):
        now = 1.0 if k == 0 else 0.0
        for a, before in zip(bottom, past, strict=True):
            now -= a * before
        past = [now, *past[:-1]]
        total += now * now
    return total
