"""The compiled fit behind every dead time is least squares on signals that SciPy has filtered."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from estimator.diagnosis.delay_fits import fit_delays
from estimator.diagnosis.innovations import power_of_load


@pytest.mark.parametrize("second", [0.0, 0.4])
@pytest.mark.parametrize(("drifts", "jumps"), [(False, ()), (True, ()), (True, (41, 130, 299))])
def test_gain_deviation_and_rest_are_those_of_least_squares(
    drifts: bool, jumps: tuple[int, ...], second: float
) -> None:
    rng = np.random.default_rng(5)
    n, first, late = 300, 40, 6
    u = np.cumsum(rng.normal(size=n))
    y = 0.4 * lfilter([0.0, 0.0, 0.3], [1.0, -0.7], u) + rng.normal(size=n) + 0.01 * np.arange(n)
    out = np.array(jumps, dtype=np.int64)
    used = np.setdiff1d(np.arange(n - first), out - first)
    top, bottom = np.array([1.0, -1.5, 0.56]), np.array([1.0, -0.9, 0.2])
    found = fit_delays(y, u, (0.7, 0.3, second), top, bottom, late, first, drifts, out)
    behind = lfilter([1.0 - second], [1.0, -second], lfilter([0.3], [1.0, -0.7], u - u[0]))
    answer = lfilter(top, bottom, behind)
    levels = [np.ones(n), np.arange(n) / n][: 1 + drifts]
    for d in range(1, late + 1):
        columns = [answer[first - d : n - d]] + [lfilter(top, bottom, x)[first:] for x in levels]
        table = np.stack(columns, axis=1)[used]
        target = lfilter(top, bottom, y - y[0])[first:][used]
        gains, squares, _, _ = np.linalg.lstsq(table, target, rcond=None)
        power = 1.0 / np.linalg.inv(table.T @ table)[0, 0]
        expected = squares[0], gains[0], power
        np.testing.assert_allclose([one[d - 1] for one in found], expected, rtol=1e-8)


def test_power_of_a_load_with_one_corner_is_that_of_its_geometric_series() -> None:
    assert power_of_load(np.array([1.0, -0.9])) == pytest.approx(1.0 / (1.0 - 0.81), rel=1e-12)
    assert power_of_load(np.array([1.0, -1.0])) == 2000.0
