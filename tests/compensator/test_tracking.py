"""What the trackers make of a valve whose friction is not that of its block."""

import math

import numpy as np
import pytest

from compensator import HybridMpc
from compensator.prediction import Prediction
from compensator.stem_tracking.belief import GAIN
from compensator.stem_tracking.stem import StemTracker
from compensator.stem_tracking.tracker_settings import TrackerSettings
from compensator.stem_tracking.tracking import NOISE_KINDS, TrackerBank
from loop_model import LoopModel, ProcessModel, ValveModel
from tests.seeds import in_suite

POLE = math.exp(-1.0 / 9.0)
PROCESS = ProcessModel((-POLE,), (1.3 * (1.0 - POLE),), 3, 0.0, 1.0)
TOLD = ValveModel(6.0, 2.0)


def bank_of(process: ProcessModel) -> TrackerBank:
    prediction = Prediction.of(process, "input")
    return TrackerBank(prediction, TOLD, TrackerSettings(NOISE_KINDS[0]), NOISE_KINDS)


class Plant:
    """The process behind a valve, at rest at zero."""

    def __init__(self, valve: ValveModel) -> None:
        self.stem = 0.0
        self._valve, self._pv, self._late = valve, 0.0, [0.0] * (PROCESS.dead_time - 1)

    def step(self, op: float, noise: float = 0.0, load: float = 0.0) -> float:
        """PV after an OP; the noise passes through the process, the load enters with the stem."""
        self.stem = self._valve.step(self.stem, op)
        self._late.append(self.stem + load)
        self._pv = POLE * self._pv + PROCESS.b[0] * self._late.pop(0) + noise
        return self._pv


@pytest.mark.parametrize("factor", [1.0, 1.3, 0.75])
def test_the_friction_that_a_record_shows_is_believed(factor: float) -> None:
    valve = ValveModel(factor * TOLD.stick_band, factor * TOLD.slip_jump)
    bank = bank_of(PROCESS)
    noise = np.random.default_rng(3).normal(0.0, 0.1, 600)
    plant = Plant(valve)
    # A controller's integral sends OP to and fro beyond the stick band.
    for k in range(600):
        op = 6.5 * (abs((k % 120) - 60) / 30.0 - 1.0)
        bank.observe(plant.step(op) + noise[k], op)
    believed = bank.chosen.valve.static_friction
    assert believed == pytest.approx(valve.static_friction, rel=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_a_long_rest_makes_nothing_forgotten(seed: int) -> None:
    """OP reaches the static friction, so that the stem may have slipped or not; PV tells which."""
    tracker = StemTracker(Prediction.of(PROCESS, "input"), TOLD, TrackerSettings(NOISE_KINDS[0]))
    noise = np.random.default_rng(seed).normal(0.0, 0.03, 2400)
    plant = Plant(TOLD)
    for k in range(noise.size):
        # to and fro first: then it is known where the stem stands
        op = 8.0 * (-1.0) ** (k // 100) if k < 400 else 0.0
        if 440 <= k < 442:
            op = plant.stem + TOLD.static_friction * 1.02
        tracker.observe(plant.step(op, noise[k]), op)
        if k == 560:
            sure = tracker.chances[0]
    assert tracker.best.stem == pytest.approx(plant.stem, abs=0.2)
    assert sure > 0.9
    assert tracker.chances[0] > 0.9


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_a_gain_twice_that_of_the_model_is_believed_after_a_few_moves(factor: float) -> None:
    bank = bank_of(ProcessModel(PROCESS.a, (PROCESS.b[0] / factor,), PROCESS.dead_time, 0.0, 1.0))
    noise = np.random.default_rng(2).normal(0.0, 0.1, 200)
    plant = Plant(TOLD)
    for k in range(noise.size):
        op = (0.0, 7.0, 0.0, -7.0)[k // 50 % 4]
        bank.observe(plant.step(op) + noise[k], op)
    gain = 1.0 + float(bank.chosen.best.errors[GAIN])
    assert gain == pytest.approx(factor, rel=0.15)


@pytest.mark.parametrize(("scans", "seed"), [(5, 0), (8, 4)])
def test_a_load_that_goes_when_a_move_is_answered_is_no_larger_gain(scans: int, seed: int) -> None:
    """PV comes back farther than the model has it, because the load has gone meanwhile."""
    compensator = HybridMpc(LoopModel(TOLD, PROCESS))
    noise = np.random.default_rng(seed).normal(0.0, 0.13, 480)
    plant, op = Plant(TOLD), 0.0
    for k in range(noise.size):
        # to and fro first, then the compensator, then a load of a stick band for some scans
        load = 6.0 if 300 <= k < 300 + scans else 0.0
        compensator.observe(plant.step(op, load=load) + noise[k], 50.0 + op)
        decided = compensator.decide(0.0).op - 50.0
        op = 7.0 * (-1.0) ** (k // 60) if k < 240 else decided
        if k >= 300:
            assert compensator.tracker.settings.gain == 1.0


@pytest.mark.parametrize("factor", in_suite(3, [1.0, 0.5, -1.0, 2.0, -0.5]))
def test_moves_of_the_stem_tell_the_sign_of_the_gain(factor: float) -> None:
    """OP rests in between for longer than the process takes to settle: a load could be the reason
    of each answer, but not of all of them.
    """
    told = ProcessModel(PROCESS.a, (PROCESS.b[0] / factor,), PROCESS.dead_time, 0.0, 1.0)
    for seed in range(3):
        bank = bank_of(told)
        noise = np.random.default_rng(seed).normal(0.0, 0.15, 400)
        plant, opposed = Plant(TOLD), []
        for k in range(noise.size):
            op = (0.0, 7.0, 0.0, -7.0)[k // 50 % 4]
            bank.observe(plant.step(op) + noise[k], op)
            opposed.append(bank.opposed)
        assert any(opposed) is (factor < 0.0)
