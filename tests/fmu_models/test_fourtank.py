"""The four tanks against Johansson's paper and SciPy; two valves that stick for themselves."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import integrate, signal

from fmu_models import PlantStepError, open_plant
from loop_model import ValveModel

Array = NDArray[np.float64]
QUIET = {"noise_std": 0.0, "valve1": 0, "valve2": 0}
AREA, HOLE = np.array([28.0, 32.0, 28.0, 32.0]), np.array([0.071, 0.057, 0.071, 0.057])


def simulate(inputs: list[dict[str, float]], **parameters: float) -> dict[str, Array]:
    with open_plant("fourtank", parameters={**QUIET, **parameters}, isolated=False) as plant:
        rows = [plant.outputs(), *plant.steps(inputs)]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@pytest.mark.parametrize(
    ("setting", "printed"),
    [
        ({}, (12.4, 12.7, 1.8, 1.4)),
        (
            {"gamma1": 0.43, "gamma2": 0.34, "k1": 3.14, "k2": 3.29, "op1": 52.5, "op2": 52.5},
            (12.6, 13.0, 4.8, 4.9),
        ),
    ],
)
def test_rest_is_the_papers_operating_point(
    setting: dict[str, float], printed: tuple[float, ...]
) -> None:
    """Table 2 prints measured levels; the paper's own model meets them to a few millimetres."""
    rest = simulate([], **setting)
    levels = [rest[name][0] for name in ("pv1", "pv2", "level3", "level4")]
    np.testing.assert_allclose(levels, printed, atol=0.5)


def test_small_steps_are_the_papers_transfer_functions() -> None:
    """G-(s) of section III: gains 2.6, 1.5, 1.4, 2.8 V/V and time constants 62, 90, 23, 30 s."""
    columns = {}
    for number in (1, 2):
        inputs = [{f"op{number}": 50.5}] * 900
        columns[number] = simulate(inputs)
    volts, per_cm = 0.005 * 6.0, 0.5
    for (pv, op), (gain, lags) in {
        (1, 1): (2.6, [62.0]),
        (1, 2): (1.5, [23.0, 62.0]),
        (2, 1): (1.4, [30.0, 90.0]),
        (2, 2): (2.8, [90.0]),
    }.items():
        level = columns[op][f"pv{pv}"]
        response = per_cm * (level - level[0]) / volts
        denominator = np.array([1.0])
        for lag in lags:
            denominator = np.polymul(denominator, [lag, 1.0])
        _, expected = signal.step(([gain], denominator), T=np.arange(901.0))
        np.testing.assert_allclose(response, expected, atol=0.06 * gain)


def test_large_steps_against_an_integrator_with_error_control() -> None:
    moves = [(70.0, 30.0)] * 60 + [(20.0, 90.0)] * 60
    outputs = simulate([{"op1": a, "op2": b, "load1": 1.0, "load2": -0.5} for a, b in moves])
    state = np.array([outputs[n][0] for n in ("pv1", "pv2", "level3", "level4")])
    expected = [state]
    for a, b in moves:
        q1, q2 = 0.06 * a * 3.33, 0.06 * b * 3.35
        inflow = np.array([0.7 * q1 + 1.0, 0.6 * q2 - 0.5, 0.4 * q2, 0.3 * q1])

        def rates(_: float, h: Array, inflow: Array = inflow) -> Array:
            out = HOLE * np.sqrt(2 * 981.0 * np.maximum(h, 0.0))
            return (inflow - out + np.array([out[2], out[3], 0.0, 0.0])) / AREA

        state = integrate.solve_ivp(rates, (0.0, 1.0), state, rtol=1e-10, atol=1e-12).y[:, -1]
        expected.append(state)
    actual = np.column_stack([outputs[n] for n in ("pv1", "pv2", "level3", "level4")])
    np.testing.assert_allclose(actual, expected, rtol=1e-7)


def test_each_valve_sticks_for_itself() -> None:
    op1 = 50.0 + 12.0 * np.sin(np.arange(200) / 9.0)
    op2 = 50.0 + 9.0 * np.sin(np.arange(200) / 13.0)
    worn = {"valve1": 1, "valve2": 1, "stick_band1": 5.0, "slip_jump1": 2.0, "stick_band2": 3.0}
    outputs = simulate([{"op1": a, "op2": b} for a, b in zip(op1, op2, strict=True)], **worn)
    for number, op, valve in ((1, op1, ValveModel(5.0, 2.0)), (2, op2, ValveModel(3.0, 1.0))):
        np.testing.assert_allclose(outputs[f"stem{number}"][1:], valve.simulate(op, 50.0))


def test_controllers_inside_hold_both_levels() -> None:
    outputs = simulate([{"sp1": 13.4, "sp2": 12.0}] * 900, controller1=1, controller2=1)
    assert outputs["pv1"][-1] == pytest.approx(13.4, abs=1e-3)
    assert outputs["pv2"][-1] == pytest.approx(12.0, abs=1e-3)
    sticky = simulate(
        [{"sp1": 13.4, "sp2": 12.0}] * 900, controller1=1, controller2=1, valve1=1, valve2=1
    )
    assert sticky["pv1"][-400:].std() > 0.01


def test_slip_jump_above_stick_band_is_refused_for_either_valve() -> None:
    for number in (1, 2):
        with pytest.raises(PlantStepError, match="slip_jump must not exceed stick_band"):
            simulate([], **{f"slip_jump{number}": 9.0})
