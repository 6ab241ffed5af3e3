"""The reporting family: its nominal models answer as its plants do, and harm is counted as told."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.apart.loops import WARM, Course, nominal
from benchmarks.apart.plants import PROCESSES, VALVES, ApartPlant
from benchmarks.compensation_apart import judge


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
