"""ARMAX against simulated truth and against a likelihood written down and minimised elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from estimator.outcomes import EstimatorError
from estimator.processes.armax import ArmaxOrders, armax
from loop_model import ProcessModel

PROCESS = ProcessModel((-1.5, 0.56), (0.03, 0.06), 2, 0.7, 1.0)
C = (-0.9, 0.25)


def _stem(samples, seed):
    """Steps of random length and size, as a stem that slips."""
    rng = np.random.default_rng(seed)
    return 50.0 + np.repeat(rng.normal(0.0, 4.0, samples // 10 + 1), 10)[:samples]


def _coloured(samples, seed, c=C, deviation=0.05):
    rng = np.random.default_rng(seed)
    e = rng.normal(0.0, deviation, samples)
    v = e.copy()
    for i, value in enumerate(c, start=1):
        v[i:] += value * e[:-i]
    return v


def test_it_finds_a_known_model_within_its_own_deviations():
    stem = _stem(5000, 1)
    pv = PROCESS.simulate(stem, noise=_coloured(5000, 2))
    fit = armax(stem, pv, ArmaxOrders(2, 2, 2, dead_time=2))
    truth = np.array([*PROCESS.a, *PROCESS.b, *C, PROCESS.offset])
    found = np.array([*fit.a, *fit.b, *fit.c, fit.offset])
    deviation = np.sqrt(np.diag(fit.covariance))
    assert np.abs((found - truth) / deviation).max() < 3.0
    assert np.sqrt(fit.variance) == pytest.approx(0.05, rel=0.03)
    assert abs(fit.process.gain - PROCESS.gain) < 3.0 * fit.gain_deviation
    assert fit.converged


def test_deviations_are_those_of_many_runs():
    stem = _stem(600, 3)
    fits = [
        armax(stem, PROCESS.simulate(stem, noise=_coloured(600, s)), ArmaxOrders(2, 2, 2, 2))
        for s in range(60)
    ]
    gains = np.array([fit.process.gain for fit in fits])
    claimed = np.median([fit.gain_deviation for fit in fits])
    assert gains.std() == pytest.approx(claimed, rel=0.3)


def test_no_other_minimiser_finds_less():
    stem = _stem(300, 5)
    pv = PROCESS.simulate(stem, noise=_coloured(300, 6))
    fit = armax(stem, pv, ArmaxOrders(2, 1, 1, dead_time=2))

    def squares(theta):
        a, b, c, offset = theta[:2], theta[2], theta[3], theta[4]
        error, total = 0.0, 0.0
        for k in range(2, 300):
            predicted = offset - a[0] * pv[k - 1] - a[1] * pv[k - 2] + b * stem[k - 2] + c * error
            error = pv[k] - predicted
            total += error * error
        return total

    ours = np.array([*fit.a, *fit.b, *fit.c, fit.offset])
    reached = squares(ours)
    assert reached == pytest.approx(float(np.nansum(np.square(fit.innovation))), rel=1e-9)
    scale = np.abs(ours) + 1e-3
    other = minimize(
        lambda t: squares(t * scale), ours / scale * 1.02, method="Nelder-Mead",
        options={"maxiter": 1500, "maxfev": 1500, "xatol": 1e-7, "fatol": 1e-10, "adaptive": True},
    )  # fmt: skip
    assert reached <= other.fun * (1.0 + 1e-9)


def test_without_c_it_is_least_squares():
    stem = _stem(400, 7)
    pv = PROCESS.simulate(stem, noise=_coloured(400, 8, c=()))
    fit = armax(stem, pv, ArmaxOrders(2, 2, 0, dead_time=2))
    rows = np.arange(3, 400)
    design = np.column_stack(
        [-pv[rows - 1], -pv[rows - 2], stem[rows - 2], stem[rows - 3], np.ones(rows.size)]
    )
    theta = np.linalg.lstsq(design, pv[rows], rcond=None)[0]
    np.testing.assert_allclose([*fit.a, *fit.b, fit.offset], theta, rtol=1e-6, atol=1e-9)


def test_measurement_noise_biases_arx_and_not_armax():
    stem = _stem(3000, 9)
    rng = np.random.default_rng(10)
    pv = PROCESS.simulate(stem) + rng.normal(0.0, 0.4, stem.size)
    arx = armax(stem, pv, ArmaxOrders(2, 2, 0, dead_time=2))
    full = armax(stem, pv, ArmaxOrders(2, 2, 2, dead_time=2))
    poles = np.sort(np.roots([1.0, *PROCESS.a]))

    def wrong(fit):
        return float(np.abs(np.sort_complex(np.roots([1.0, *fit.a])) - poles).max())

    assert wrong(full) < 0.2 * wrong(arx)
    # White noise on PV is C = A.
    np.testing.assert_allclose(full.c, full.a, atol=0.1)


def test_units_and_bad_samples():
    stem = _stem(800, 11)
    pv = PROCESS.simulate(stem, noise=_coloured(800, 12))
    orders = ArmaxOrders(2, 2, 1, dead_time=2)
    fit = armax(stem, pv, orders)
    scaled = armax(3.0 * stem - 100.0, -20.0 * pv + 7.0, orders)
    np.testing.assert_allclose(scaled.a, fit.a, rtol=1e-5)
    np.testing.assert_allclose(scaled.b, np.array(fit.b) * -20.0 / 3.0, rtol=1e-5)
    assert scaled.process.gain == pytest.approx(fit.process.gain * -20.0 / 3.0, rel=1e-5)
    bad = pv.copy()
    bad[100:110] = np.nan
    patched = armax(stem, bad, orders)
    assert patched.rows == fit.rows - 12
    np.testing.assert_allclose(patched.a, fit.a, atol=0.05)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pv": np.zeros(3)}, "one length"),
        ({"stem": np.full(200, 1.0)}, "does not move"),
        ({"stem": np.full(200, np.nan)}, "finite"),
        ({"good": np.ones(5, dtype=bool)}, "one flag each"),
        ({"orders": ArmaxOrders(15, 15, 15)}, "longer window"),
    ],
)
def test_it_says_what_is_wrong(change, message):
    stem = _stem(200, 13)
    given = {"stem": stem, "pv": PROCESS.simulate(stem), "orders": ArmaxOrders(2, 2, 1), **change}
    good = given.pop("good", None)
    with pytest.raises(EstimatorError, match=message):
        armax(**given, good=good)


def test_impossible_orders_are_refused():
    with pytest.raises(EstimatorError, match="nb >= 1"):
        ArmaxOrders(2, 0, 1)
