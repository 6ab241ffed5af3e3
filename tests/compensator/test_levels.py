"""Levels: which of them the stem can set finely enough, and what a ramp asks of them."""

import numpy as np
import pytest

from compensator import HybridMpc, LoopFigures, SupervisorSettings
from compensator.action import CompensatorError
from compensator.supervising.admission import Admission
from compensator.supervising.figures import LoopRecord
from compensator.supervising.loop_judge import LoopJudge
from compensator.supervising.watch import WatchVerdict
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
