"""The loops with their controller inside against python-control: whole closed loops, not parts."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_models import catalogue, open_plant
from fmu_models.tables import SOURCES, read_model

control = pytest.importorskip("control", reason="pip install control")

REST = {"example1": 50.0, "example2": 50.0, "heat": 60.0, "level": 50.0}


@pytest.mark.parametrize("name", sorted(REST))
def test_step_of_the_set_point_and_of_the_load(name: str) -> None:
    """Healthy valve, no noise: y = CP/(1+CP) r + P/(1+CP) d, sampled at the plant's period."""
    model = catalogue[name]
    process = model.process
    assert process is not None
    start = {v.name: v.start for v in read_model(SOURCES / f"{name}.c").variables}
    T, K, Ti = model.period, start["pi_gain"], start["pi_time"]
    # Polynomials in z^-1, written as polynomials in z of one length.
    length = process.dead_time + max(len(process.b), len(process.a) + 1)
    b = np.zeros(length)
    b[process.dead_time : process.dead_time + len(process.b)] = process.b
    a = np.zeros(length)
    a[: len(process.a) + 1] = [1.0, *process.a]
    P = control.tf(b, a, T)
    C = control.tf([K * (1.0 + T / Ti), -K], [1.0, -1.0], T)
    n = 400
    r = np.where(np.arange(n) < 20, 0.0, 2.0)
    d = np.where(np.arange(n) < 200, 0.0, -3.0)
    t = T * np.arange(n)
    expected = sum(
        control.forced_response(control.feedback(forward, back), t, signal).outputs
        for forward, back, signal in ((C * P, 1, r), (P, C, d))
    )
    parameters = {"valve": 0, "noise_std": 0.0, "controller": 1, "sp": REST[name]}
    with open_plant(name, parameters=parameters, isolated=False) as plant:
        first = plant.outputs()["pv"]
        assert first == pytest.approx(REST[name], abs=1e-6)
        table = plant.run(n - 1, {"sp": REST[name] + r[:-1], "load": d[:-1]})
    np.testing.assert_allclose(table["pv"], REST[name] + expected[1:], atol=1e-6)
    assert np.ptp(expected) > 1.0
    assert abs(expected[199] - 2.0) < 0.5
