"""The reporting family: its nominal models answer as its plants do, and harm is counted as told."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.apart.loops import WARM, Course, Loop, asked_way, nominal
from benchmarks.apart.plants import PROCESSES, VALVES, ApartPlant
from benchmarks.compensation_apart import judge
from benchmarks.tuned.linear_plants import TwoStops
from estimator.valves import KanoValve


@pytest.mark.parametrize("name", PROCESSES)
def test_the_nominal_model_answers_like_the_plant(name: str) -> None:
    process = PROCESSES[name]
    plant = ApartPlant(process, VALVES["He"](0.0, 0.0, 50.0))
    op = np.concatenate([np.full(5, 50.0), np.full(75, 50.4)])
    pv = [plant.pv] + [plant.step(float(u)) for u in op[:-1]]
    told = nominal(process).simulate(op, pv0=[0.0, 0.0])
    assert np.abs(np.array(pv) - told).max() < 0.03 * np.abs(pv).max()


@pytest.mark.parametrize("valve", VALVES)
def test_a_valve_sticks_inside_its_band_and_slips_beyond_it(valve: str) -> None:
    stem = VALVES[valve](6.0, 2.0, 50.0)
    for k in range(200):
        inside = stem.move(50.0 + 3.9 * min(1.0, k / 100.0), 0.1)
    assert inside == 50.0 or valve == "Kano"  # Kano's starts as if it had just moved up
    for _ in range(100):
        far = stem.move(60.0, 0.1)
    assert 56.0 <= far <= 60.0


def test_both_families_follow_kano_s_flow_chart() -> None:
    """OP that turns, rests and comes back from far inside the band tells the flow chart apart from
    one that looks at OP's last change alone.
    """
    rng = np.random.default_rng(3)
    op = 50.0 + np.cumsum(rng.choice([-3.0, -0.4, 0.0, 0.0, 0.4, 3.0], 400))
    op[0] = 50.0
    told = KanoValve(6.0, 2.0).simulate(op, 50.0)
    apart, tuned = VALVES["Kano"](6.0, 2.0, 50.0), TwoStops(6.0, 2.0, 50.0, rng)
    seen = np.array([[apart.move(float(u), 1.0), tuned.move(float(u), 1.0)] for u in op])
    later = slice(100, None)  # the first state is forgotten by then
    assert np.count_nonzero(np.diff(told[later])) > 20
    assert seen[later] == pytest.approx(np.column_stack([told, told])[later])


@pytest.mark.parametrize("process", ["first order", "level"])
def test_a_ramp_asks_for_its_way_and_a_slip_a_turn(process: str) -> None:
    loop = Loop(process, "He", "pi")
    asked = asked_way(loop, "ramps")
    slope = 2.0 * loop.band * loop.scale / 200.0
    gain = PROCESSES[process].gain
    one_leg = 2.0 * slope / gain if process == "level" else 200.0 * slope / gain
    assert asked[WARM + 100 : WARM + 300].sum() == pytest.approx(one_leg + loop.jump, rel=0.02)
    assert asked[:WARM].sum() == 0.0
    assert asked_way(loop, "load step").sum() == 0.0


def course(after: float, travel: float) -> Course:
    k = np.arange(1700)
    size = np.where(k < WARM, 1.0, after)
    stem = np.cumsum(np.where(k < WARM, 1.0, travel) * np.where(k % 2, 1.0, -1.0))
    held = k >= WARM
    return Course(size * np.sin(k / 5.0), stem, stem, held, "", True)


def test_harm_is_worse_pv_and_more_travel_together() -> None:
    assert judge(course(0.4, 0.5))["pv"] == pytest.approx(0.4, rel=0.02)
    assert judge(course(0.4, 0.5))["travel"] == pytest.approx(0.5, rel=0.02)
    assert judge(course(1.5, 1.0))["harmed"] == 0
    assert judge(course(0.9, 3.0))["harmed"] == 0
    assert judge(course(1.5, 3.0))["harmed"] > 60
    assert judge(course(4.0, 0.0))["harmed"] >= 1
