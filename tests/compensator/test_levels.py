"""Levels: which of them the stem can set finely enough, and what a ramp asks of them."""

import numpy as np
import pytest
from scipy.signal import lfilter

from compensator import (
    HybridMpc,
    LoopFigures,
    PiController,
    PiSettings,
    Supervisor,
    SupervisorSettings,
)
from compensator.action import CompensatorError
from compensator.supervising.admission import Admission
from compensator.supervising.figures import LoopRecord
from compensator.supervising.loop_judge import LoopJudge
from compensator.supervising.watch import WatchVerdict
from fieldlink.lab.study.closed_loop import Plant
from loop_model import LoopModel, ProcessModel, ValveModel

VALVE = ValveModel(5.0, 2.5)
LAG = ProcessModel((-0.95,), (0.035,), 6, 0.0, 1.0)
LEVEL = ProcessModel((-1.0,), (0.02,), 5, 0.0, 1.0)


def test_a_level_is_refused_that_the_stem_cannot_set_finely_enough() -> None:
    admission, model = Admission(SupervisorSettings()), LoopModel(VALVE, LEVEL)
    # J and a fifth of fS, for two scans: 3.25 * 2 * 0.02.
    admission.require_fine_enough(model.valve, model.process, LoopFigures(0.14**2, 1.0, 40.0, 1.0))
    restless = LoopFigures(0.12**2, 1.0, 40.0, 1.0)
    with pytest.raises(CompensatorError, match="cannot halve"):
        admission.require_fine_enough(model.valve, model.process, restless)
    # A process that settles needs no way back.
    admission.require_fine_enough(VALVE, LAG, restless)


def test_a_lag_longer_than_the_period_is_no_finer_to_set_than_a_level() -> None:
    # In cycles of 12 scans a lag of 19.5 and a level look the same: 3.25 * 2 * 0.035 = 0.23.
    admission, fast = Admission(SupervisorSettings()), LoopFigures(0.2**2, 1.0, 12.0, 1.0)
    with pytest.raises(CompensatorError, match="cannot halve"):
        admission.require_fine_enough(VALVE, LAG, fast)
    # Cycles long enough for the lag to show.
    admission.require_fine_enough(VALVE, LAG, LoopFigures(0.2**2, 1.0, 24.0, 1.0))
    # A loop at rest has the period of its noise.
    admission.require_fine_enough(VALVE, LAG, LoopFigures(0.2**2, 0.0, 12.0, 1.0))
    # Where the slips are that large, the stem can set them finer.
    admission.require_fine_enough(VALVE, LAG, LoopFigures(0.3**2, 1.0, 12.0, 1.0))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("process", "given_back"), [(LEVEL, True), (LAG, False)])
def test_a_ramp_asks_a_level_for_another_slope_once(
    process: ProcessModel, seed: int, *, given_back: bool
) -> None:
    # The stem goes on as far as a process that settles needs to follow: a level needs no travel.
    compensator = HybridMpc(LoopModel(VALVE, process))
    judge = LoopJudge(SupervisorSettings(), LoopRecord(1200))
    noise = np.random.default_rng(seed).normal(0.0, 0.02, 700)
    for k in range(100):
        compensator.observe(float(noise[k]), 0.0)
    judge.begin(LoopFigures(0.25, 0.01, 60.0, 1.5), compensator)
    slope = 0.15 * compensator.prediction.scale
    found = {
        judge.push(compensator, slope * k + float(noise[k]), slope * k, 0.0, 0.15)
        for k in range(700)
    }
    assert (WatchVerdict.TRAVEL in found) is given_back


def test_waves_on_a_level_are_not_taken_for_a_load_that_walks() -> None:
    valve, tank = ValveModel(3.4, 2.2), ProcessModel((-1.0,), (0.018,), 2, -0.9, 1.0)
    error, way = np.empty((4, 1300)), np.empty((4, 1300))
    for row, seed in enumerate((0, 2, 3, 7)):
        waves = lfilter([0.024], [1.0, -0.8], np.random.default_rng(seed).normal(size=1300))
        supervisor = Supervisor(PiController(PiSettings(3.4, 30.0, 1.0)))
        plant, op = Plant(tank, valve, 50.0, 49.0), 50.0
        for k in range(1300):
            if k == 500:
                assert supervisor.offer(LoopModel(valve, tank))
            op = supervisor.step(plant.pv + float(waves[k]), 0.5, op).op
            stem = plant.stem
            plant.step(op)
            error[row, k], way[row, k] = plant.pv - 0.5, abs(plant.stem - stem)
        # With a tracker of such a load, two of these four were given back.
        assert supervisor.compensating
    before, after = slice(150, 500), slice(600, 1300)
    assert np.std(error[:, after]) < 0.35 * np.std(error[:, before])
    assert np.mean(way[:, after]) < 0.5 * np.mean(way[:, before])


def test_on_a_ramp_the_stem_of_a_level_goes_to_where_the_ramp_needs_it() -> None:
    valve, tank = ValveModel(6.0, 2.0), ProcessModel((-1.0,), (0.018,), 3, -0.9, 1.0)
    ways, errors = [], []
    for seed in range(3):
        noise = np.random.default_rng(seed).normal(0.0, 0.036, 1000)
        compensator, plant = HybridMpc(LoopModel(valve, tank)), Plant(tank, valve, 50.0, 50.0)
        compensator.improve_on(0.55, 0.12)
        op, stem, error = 50.0, np.empty(1000), np.empty(1000)
        for k in range(1000):
            sp = 4.3 * (1.0 - abs((k - 100) % 400 - 200) / 200.0) if k >= 100 else 0.0
            compensator.observe(plant.pv + float(noise[k]), op)
            op = compensator.decide(sp).op
            plant.step(op)
            stem[k], error[k] = plant.stem, plant.pv - sp
        ways.append(np.abs(np.diff(stem[150:])).sum())
        errors.append(np.std(error[150:]))
    # With plans beyond the end of the ramp they were 91 OP and 0.30: to and fro.
    assert np.mean(ways) < 75.0
    assert np.mean(errors) < 0.25
