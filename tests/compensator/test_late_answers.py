"""Models whose answer comes too soon, whose lag is a level, whose gain is far too large."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from compensator import HybridMpc, PiController, PiSettings, Supervisor, SupervisorSettings
from compensator.hybrid.slow_lags import as_planned
from compensator.supervising.figures import LoopFigures, LoopRecord
from compensator.supervising.loop_judge import LoopJudge
from compensator.supervising.watch import WatchVerdict
from fieldlink.lab.study.closed_loop import Plant
from loop_model import LoopModel, ProcessModel, ValveModel
from tests.seeds import few_and_all, in_suite

VALVE = ValveModel(6.0, 2.0)
LAG = ProcessModel((-0.9355,), (0.0645,), 10, 0.0, 1.0)
LEVEL = ProcessModel((-1.0,), (0.03,), 3, -1.5, 1.0)
LEVEL_AS_LAG = ProcessModel((-0.99925,), (0.03,), 3, 0.0, 1.0)
"""The same as a window of 700 samples may show it: 1,333 samples of lag."""


def compensated(
    process: ProcessModel, model: LoopModel, own: PiSettings, sp: float, noise: float, seed: int
) -> tuple[Supervisor, np.ndarray, np.ndarray]:
    """Run a loop under its own PI, from scan 800 with a model and another set-point."""
    supervisor = Supervisor(PiController(own))
    plant = Plant(process, VALVE, 50.0, 49.0)
    rest, op = plant.pv, 50.0
    white = np.random.default_rng(seed).normal(0.0, noise, 1500)
    error, stem = np.empty(1500), np.empty(1500)
    for k in range(1500):
        if k == 800:
            supervisor.offer(model)
        wanted = rest + (sp if k >= 20 else 0.0) * (1.0 if k < 820 else 0.6)
        action = supervisor.step(plant.pv + white[k], wanted, op)
        op = action.op
        plant.step(op, 0.0)
        error[k], stem[k] = plant.pv - wanted, plant.stem
    return supervisor, error, stem


@pytest.mark.parametrize("seeds", few_and_all(2, range(1, 6)))
def test_a_dead_time_three_samples_too_short_does_not_chase_its_own_moves(
    seeds: Sequence[int],
) -> None:
    """Without a tracker of the later answer each of these loops was given back for its travel."""
    model = LoopModel(VALVE, ProcessModel(LAG.a, LAG.b, 7, 0.0, 1.0))
    runs = [compensated(LAG, model, PiSettings(0.28, 12.0), 2.4, 0.1, n) for n in seeds]
    assert sum(supervisor.compensating for supervisor, _, _ in runs) >= 0.8 * len(seeds)
    assert all(np.abs(np.diff(stem[820:])).sum() < 40.0 for _, _, stem in runs)


@pytest.mark.parametrize("seeds", few_and_all(2, range(1, 5)))
def test_a_dead_time_six_samples_too_long_is_seen_through(seeds: Sequence[int]) -> None:
    """Without trackers of shorter dead times each of these levels was given back, after the stem
    had travelled 85 to 220.
    """
    late = ProcessModel(LEVEL.a, LEVEL.b, LEVEL.dead_time + 6, LEVEL.offset, 1.0)
    model = LoopModel(VALVE, late)
    runs = [compensated(LEVEL, model, PiSettings(1.4, 40.0), 1.0, 0.02, n) for n in seeds]
    assert sum(supervisor.compensating for supervisor, _, _ in runs) >= 0.75 * len(seeds)
    travels = [np.abs(np.diff(stem[820:])).sum() for _, _, stem in runs]
    assert np.median(travels) < 40.0


@pytest.mark.parametrize("seed", in_suite(1, range(1, 5)))
def test_a_level_taken_for_a_slow_lag_does_not_leave_its_range(seed: int) -> None:
    own = PiSettings(1.4, 40.0)
    _, error, _ = compensated(LEVEL, LoopModel(VALVE, LEVEL_AS_LAG), own, 1.0, 0.06, seed)
    known = np.abs(error[100:800]).max()
    assert np.abs(error[820:]).max() < 3.0 * known


def test_a_slow_lag_is_planned_as_a_level() -> None:
    process = ProcessModel((-1.698, 0.69860), (0.03, 0.01), 2, 0.2, 1.0)  # poles 0.998, 0.7
    planned = as_planned(process, 120)
    assert planned.is_integrating
    assert planned.a == pytest.approx((-1.7, 0.7))
    assert (planned.b, planned.dead_time) == (process.b, process.dead_time)


@pytest.mark.parametrize(
    "a", [(-0.99,), (-1.8, 0.82), (-1.99, 0.9903), (-0.5, -0.3), (), (-1.0,), (0.9,)]
)
def test_what_settles_or_swings_is_planned_as_it_is(a: tuple[float, ...]) -> None:
    """A lag of 100 samples, complex poles near and far, 0.85 and -0.35, none, a level, -0.9."""
    process = ProcessModel(a, (0.1,), 1, 0.0, 1.0)
    assert as_planned(process, 120) is process


def test_a_gain_far_too_large_does_not_widen_the_range_of_a_loop_that_moved() -> None:
    settings = SupervisorSettings()
    judge = LoopJudge(settings, LoopRecord(1200))
    candidate = HybridMpc(LoopModel(VALVE, ProcessModel((-0.98,), (0.6,), 3, 0.0, 1.0)))
    before = LoopFigures(mean_square=0.25, travel=0.05, period=90.0, largest=1.0)
    judge.begin(before, candidate)
    candidate.observe(0.0, 50.0)
    assert judge.push(candidate, 0.1, 0.0, 50.0, 0.0) is WatchVerdict.FINE
    for k in range(60):
        verdict = judge.push(candidate, 4.0 + 0.01 * k, 0.0, 50.0, 0.0)
        if verdict is not WatchVerdict.FINE:
            break
    assert verdict is WatchVerdict.LEFT_RANGE
    assert k <= 40 + candidate.prediction.dead_time
    assert math.isfinite(candidate.stem)
