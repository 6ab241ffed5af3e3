"""The valves in C: what their papers say of them, and the physical one against SciPy."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import integrate

from fmu_models import PlantStepError, open_plant
from loop_model import ValveModel

Array = NDArray[np.float64]
HE, KANO, CHOUDHURY = 1, 2, 3
KARNOPP, LUGRE = 4, 5


def stem_of(op: Array, *, name: str = "example1", **parameters: float) -> Array:
    with open_plant(name, parameters={"noise_std": 0.0, **parameters}, isolated=False) as plant:
        return np.array([row["stem"] for row in plant.steps([{"op": value} for value in op])])


def triangle(step: float) -> Array:
    """OP from 50 up to 70, down to 30 and up again, in small steps that never pause."""
    up = np.arange(50.0, 70.0, step)
    down = np.arange(70.0, 30.0, -step)
    again = np.arange(30.0, 70.0, step)
    return np.concatenate([up, down, again])


@pytest.mark.parametrize("kind", [HE, KANO, CHOUDHURY])
@pytest.mark.parametrize(("band", "jump"), [(8.0, 2.0), (6.0, 6.0), (5.0, 0.0)])
def test_triangle_shows_stick_band_and_slip_jump(kind: int, band: float, jump: float) -> None:
    """After a reversal the stem holds until OP has come back by S, and then jumps by J."""
    step = 0.01
    op = triangle(step)
    stem = stem_of(op, valve=kind, stick_band=band, slip_jump=jump)
    top = int(np.argmax(op))
    moved = top + int(np.argmax(stem[top:] < stem[top] - 1e-9))
    if kind == HE and jump > 0.0:
        # He's stem stands still between slips; OP may reverse anywhere in a stick phase.
        assert op[moved] == pytest.approx(stem[top] - 0.5 * (band + jump), abs=2 * step)
    else:
        assert op[top] - op[moved] == pytest.approx(band, abs=2 * step)
    assert stem[moved - 1] - stem[moved] == pytest.approx(jump, abs=2 * step)
    assert stem[moved] - op[moved] == pytest.approx(0.5 * (band - jump), abs=1e-9)


@pytest.mark.parametrize("kind", [HE, KANO, CHOUDHURY])
def test_without_stick_band_the_stem_is_op(kind: int) -> None:
    op = 50.0 + 20.0 * np.sin(np.arange(100) / 5.0)
    np.testing.assert_array_equal(stem_of(op, valve=kind, stick_band=0.0, slip_jump=0.0), op)


def test_kano_holds_after_a_pause_until_op_went_on_by_the_slip_jump() -> None:
    op = np.array([60.0, 60.0, 61.9, 62.1, 62.2])
    stem = stem_of(op, valve=KANO, stick_band=8.0, slip_jump=2.0)
    np.testing.assert_allclose(stem, [57.0, 57.0, 57.0, 59.1, 59.2])


def test_choudhury_holds_by_the_slip_jump_after_a_pause_and_by_the_band_after_a_reversal() -> None:
    op = np.array([62.0, 63.0, 63.0, 64.9, 65.1, 65.0, 57.2, 57.0])
    stem = stem_of(op, valve=CHOUDHURY, stick_band=8.0, slip_jump=2.0)
    np.testing.assert_allclose(stem, [59.0, 60.0, 60.0, 60.0, 62.1, 62.1, 62.1, 60.0])


def test_he_equals_the_shared_valve_model_when_parameters_wear() -> None:
    rng = np.random.default_rng(5)
    op = 50.0 + np.cumsum(rng.normal(0.0, 2.0, 300))
    stem, positions = 50.0, []
    with open_plant("example2", isolated=False) as plant:
        for k, value in enumerate(op):
            valve = ValveModel(stick_band=2.0 + 0.02 * k, slip_jump=1.0 + 0.005 * k)
            stem = valve.step(stem, float(value))
            worn = {"stick_band": valve.stick_band, "slip_jump": valve.slip_jump}
            positions.append(plant.step({"op": value, **worn})["stem"] - stem)
    np.testing.assert_allclose(positions, 0.0, atol=1e-12)


def test_slip_jump_above_stick_band_is_refused() -> None:
    with pytest.raises(PlantStepError, match=r"slip_jump must not exceed stick_band"):
        open_plant("example1", parameters={"slip_jump": 12.0}, isolated=False)


def test_karnopp_rests_where_he_says_when_pressure_steps() -> None:
    """At errors not near the static friction of 5 %, where the last digit decides.

    (LuGre breaks away the earlier the faster it is loaded, so it has no such rule.)
    """
    valve, rng = ValveModel(8.0, 2.0), np.random.default_rng(2)
    stem, op, expected = 50.0, [], []
    while len(op) < 60:
        value = 50.0 + rng.uniform(-20.0, 20.0)
        if 4.0 < abs(value - stem) < 6.0:
            continue
        stem = valve.step(stem, value)
        op.append(value)
        expected.append(stem)
    actual = stem_of(np.array(op), name="physical", actuator_lag=0.001)
    np.testing.assert_allclose(actual, expected, atol=0.02)


@pytest.mark.parametrize("kind", [KARNOPP, LUGRE])
def test_physical_valve_with_a_pressure_lag_rests_within_j_of_he(kind: int) -> None:
    op = 50.0 + 15.0 * np.sin(np.arange(60) / 4.0)
    stem = stem_of(op, name="physical", valve=kind)
    error = op - stem
    assert np.abs(error).max() < 5.0 + 1.0  # static friction, and what the lag holds back
    assert np.ptp(stem) > 15.0


def test_lugre_slip_against_a_stiff_solver() -> None:
    """A step of OP of 8 %, beyond the static friction, sampled every 2 ms."""
    mass, spring, travel, viscous, stribeck, bristle = 1.361, 52538.0, 0.1016, 612.9, 0.000254, 1e6
    span = spring * travel
    static, coulomb = 0.05 * span, 0.03 * span
    damping = 2.0 * np.sqrt(bristle * mass)

    def derivative(t: float, state: Array) -> list[float]:
        x, v, z = state
        pressure = 58.0 - 8.0 * np.exp(-t / 0.2)
        g = coulomb + (static - coulomb) * np.exp(-((v / stribeck) ** 2))
        z_dot = v - bristle * abs(v) * z / g
        friction = bristle * z + damping * z_dot + viscous * v
        return [v, (span * pressure / 100.0 - spring * x - friction) / mass, z_dot]

    times = np.arange(0.002, 1.2, 0.002)
    solution = integrate.solve_ivp(
        derivative, (0.0, 1.2), [0.5 * travel, 0.0, 0.0], "Radau", times, rtol=1e-7, atol=1e-10
    )
    with open_plant(
        "physical",
        parameters={"valve": LUGRE, "bristle": bristle, "noise_std": 0.0},
        period=0.002,
        isolated=False,
    ) as plant:
        rows = plant.steps(list(itertools.repeat({"op": 58.0}, times.size)))
    stem = np.array([row["stem"] for row in rows])
    reference = 100.0 * solution.y[0] / travel
    assert np.ptp(reference) > 1.5  # it did slip
    assert np.sqrt(np.mean((stem - reference) ** 2)) < 0.03
    assert stem[-1] == pytest.approx(reference[-1], abs=0.05)


def test_physical_model_refuses_a_data_driven_valve() -> None:
    with pytest.raises(PlantStepError, match=r"4 \(Karnopp\) or 5 \(LuGre\)"):
        open_plant("physical", parameters={"valve": HE}, isolated=False)
