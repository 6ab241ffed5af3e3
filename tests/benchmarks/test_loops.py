"""Random loops: drawn from the name alone, physically sensible, the same every time."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.loops import FMU_PLANTS, SIMULATED, draw_loop, named_loop
from benchmarks.plants import REST, open_loop_plant, process_of, valve_law
from benchmarks.recording import record
from estimator.valves import HeValve
from tests.benchmarks.made_up import BASE


def test_a_name_gives_one_loop_and_one_window():
    assert named_loop("s5") == draw_loop(5, healthy=False)
    loop = named_loop("h6")
    assert loop.is_healthy
    assert loop.name == "h6"
    np.testing.assert_array_equal(record(loop, samples=300).pv, record(loop, samples=300).pv)


@pytest.mark.parametrize("name", ["17", "x17", "s", "h-1"])
def test_a_wrong_name_says_what_a_right_one_is(name):
    with pytest.raises(ValueError, match="name a sticky one s17"):
        named_loop(name)


def test_draws_cover_every_kind_and_stay_in_range():
    loops = [draw_loop(seed, healthy=False) for seed in range(300)]
    assert {loop.physics for loop in loops} == {"He", "Kano", "Choudhury", "Karnopp", "LuGre"}
    assert {loop.plant for loop in loops} == {*SIMULATED, *FMU_PLANTS}
    assert all(0.5 <= loop.stick_band <= 10.0 for loop in loops)
    assert all(0.0 <= loop.slip_jump <= loop.stick_band for loop in loops)
    assert all(0.05 <= loop.sampling <= 1.0 for loop in loops)
    assert all(draw_loop(seed, healthy=True).is_healthy for seed in range(20))


@pytest.mark.parametrize("physics", ["He", "Kano"])
@pytest.mark.parametrize("plant", [*SIMULATED, "flow", "pressure", "heat", "level"])
def test_a_sticky_loop_cycles_and_its_stem_stays_within_the_friction(plant, physics):
    delay = 3 if plant in ("dead time", "heat") else 0
    window = record(replace(BASE, plant=plant, physics=physics, dead_time=delay), samples=600)
    assert window.turns >= 4
    assert np.abs(window.op - window.stem).max() <= 2.5 + 0.05  # fS = (S + J) / 2


@pytest.mark.parametrize("plant", FMU_PLANTS)
def test_the_linear_process_is_that_of_the_fmu_near_op_50(plant):
    loop = replace(BASE, plant=plant, stick_band=0.0, slip_jump=0.0, physics="healthy")
    if plant == "heat":
        loop = replace(loop, dead_time=2)
    op = REST + np.repeat([0.0, 0.2, -0.1, 0.1], 25)
    with ExitStack() as keep:
        fmu = open_loop_plant(loop, keep)
        measured = np.array([fmu.step(float(u)) for u in op])
    process = process_of(loop)
    # step() returns PV at the end of the period, the model's next sample.
    linear = process.simulate(np.append(op, op[-1]), pv0=[0.0] * len(process.a))[1:]
    # The physical valve takes 0.2 s to follow, which the linear process does not know.
    allowed = 0.08 if plant == "physical" else 0.02
    assert np.abs(measured - linear).max() < allowed * np.ptp(linear)


@pytest.mark.parametrize("physics", ["Karnopp", "LuGre"])
def test_physical_friction_mostly_rests_where_hes_valve_does(physics):
    rng = np.random.default_rng(2)
    op = REST + np.cumsum(rng.normal(0.0, 1.5, 120))
    with ExitStack() as keep:
        law = valve_law(physics, 4.0, 1.0, keep)
        assert law is not None
        stem = np.array([law(0.0, float(value)) for value in op])
    he = HeValve(4.0, 1.0).simulate(op, REST)
    # The actuator's lag lets it stop short by up to J, LuGre's bristles let it creep.
    assert np.abs(stem - he).max() < 2.5
    assert np.mean(np.abs(stem - he) < 1.05) > 0.9
    assert np.mean(np.abs(np.diff(stem)) < 0.05) > 0.25


def test_a_healthy_valve_follows_op_and_bad_tuning_makes_it_swing():
    calm = replace(BASE, stick_band=0.0, slip_jump=0.0, physics="healthy")
    calm_window = record(calm, samples=400)
    np.testing.assert_array_equal(calm_window.stem, calm_window.op)
    swinging = record(replace(calm, trouble="tuning"), samples=400)
    assert swinging.op.std() > 3.0 * calm_window.op.std()
    assert np.abs(swinging.op - REST).max() < 50.0
