"""The pH plant against its equations, solved by SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, optimize

from fmu_models import open_plant

ACID, BUFFER, BASE_MAX, VOLUME, ELECTRODE = 16.6, 0.55, 31.1, 2898.0, 5.0


def equilibrium(wa: float, wb: float) -> float:
    """pH from the charge balance, with concentrations instead of the paper's combined form."""

    def charge(ph: float) -> float:
        h = 10.0**-ph
        hydroxide = 1e-14 / h
        carbonic = wb / (1.0 + 10**-6.35 / h + 10**-6.35 * 10**-10.25 / h**2)
        bicarbonate = carbonic * 10**-6.35 / h
        carbonate = bicarbonate * 10**-10.25 / h
        return h - hydroxide - bicarbonate - 2.0 * carbonate - wa

    return float(optimize.brentq(charge, 0.0, 14.0, xtol=1e-13))


def mixture(stem: float, load: float = 0.0) -> tuple[float, float, float]:
    base = stem / 100.0 * BASE_MAX
    buffer = BUFFER * (1.0 + load / 100.0)
    flow = ACID + buffer + base
    wa = (3e-3 * ACID - 3e-2 * buffer - 3.05e-3 * base) / flow
    return flow, wa, (3e-2 * buffer + 5e-5 * base) / flow


def test_nominal_point_is_the_papers() -> None:
    """Henson and Seborg: Wa4 = -4.32e-4, Wb4 = 5.28e-4 and pH 7.0 at 16.6, 0.55, 15.55 ml/s."""
    _, wa, wb = mixture(50.0)
    assert wa == pytest.approx(-4.32e-4, abs=5e-7)
    assert wb == pytest.approx(5.28e-4, abs=1e-6)
    with open_plant("ph", parameters={"noise_std": 0.0}, isolated=False) as plant:
        assert plant.outputs()["pv"] == pytest.approx(7.0, abs=0.05)


@pytest.mark.parametrize("op", [0.0, 20.0, 45.0, 50.0, 56.0, 100.0])
@pytest.mark.parametrize("load", [-80.0, 0.0, 40.0])
def test_rest_is_the_titration_curve(op: float, load: float) -> None:
    parameters = {"noise_std": 0.0, "op": op, "load": load}
    with open_plant("ph", parameters=parameters, isolated=False) as plant:
        assert plant.outputs()["pv"] == pytest.approx(equilibrium(*mixture(op, load)[1:]), abs=1e-8)


def test_steps_against_an_integrator_with_error_control() -> None:
    op = [50.0, 56.0, 56.0, 40.0, 40.0, 40.0, 62.0, 62.0]
    _, wa, wb = mixture(50.0)
    state, expected = np.array([wa, wb, equilibrium(wa, wb)]), []
    for value in op:
        flow, wa_in, wb_in = mixture(value)
        solution = integrate.solve_ivp(
            lambda _, y, q=flow, a=wa_in, b=wb_in: [
                q * (a - y[0]) / VOLUME,
                q * (b - y[1]) / VOLUME,
                (equilibrium(y[0], y[1]) - y[2]) / ELECTRODE,
            ],
            (0.0, 5.0),
            state,
            rtol=1e-9,
            atol=1e-12,
        )
        state = solution.y[:, -1]
        expected.append(state[2])
    parameters = {"valve": 0, "noise_std": 0.0}
    with open_plant("ph", parameters=parameters, isolated=False) as plant:
        actual = [row["pv"] for row in plant.steps([{"op": value} for value in op])]
    np.testing.assert_allclose(actual, expected, atol=2e-3)


def test_gain_depends_on_the_operating_point() -> None:
    def gain(op: float) -> float:
        return equilibrium(*mixture(op + 0.5)[1:]) - equilibrium(*mixture(op - 0.5)[1:])

    gains = [gain(op) for op in (25.0, 45.0, 55.0, 80.0)]
    assert max(gains) > 8.0 * min(gains) > 0.0
    for op, expected in zip((25.0, 45.0, 55.0, 80.0), gains, strict=True):
        points = []
        for value in (op - 0.5, op + 0.5):
            with open_plant(
                "ph", parameters={"op": value, "noise_std": 0.0}, isolated=False
            ) as plant:
                points.append(plant.outputs()["pv"])
        assert points[1] - points[0] == pytest.approx(expected, abs=1e-7)
