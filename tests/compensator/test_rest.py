"""A loop at rest stays at rest: OP changes its place for evidence, not for a tie."""

from dataclasses import replace

import numpy as np
import pytest

from compensator import HybridMpc
from compensator.stem_tracking.belief import Belief
from compensator.stem_tracking.stem_hypotheses import likely_ones
from compensator.stem_tracking.tracker_settings import TrackerSettings
from compensator.stem_tracking.tracking import NOISE_KINDS
from loop_model import LoopModel, ProcessModel, ValveModel

SETTINGS = TrackerSettings(NOISE_KINDS[0])
LOOP = LoopModel(ValveModel(8.0, 2.0), ProcessModel((-1.7, 0.72), (0.02, 0.02), 4, 0.0, 1.0))


def at(stem: float, score: float) -> Belief:
    return Belief(stem, 0.0, np.zeros(2), np.zeros(3), score=score)


def test_of_two_positions_that_are_alike_the_present_one_is_kept() -> None:
    present, other = at(50.0, -3.0), at(52.0, -3.0 + 1e-9)
    assert likely_ones([present, other], SETTINGS) == [present, other]
    likelier = at(52.0, -1.0)
    assert likely_ones([present, likelier], SETTINGS) == [likelier, present]
    exact = replace(SETTINGS, alike=0.0)
    assert likely_ones([present, other], exact) == [other, present]


@pytest.mark.parametrize("seed", range(4))
def test_noise_alone_never_moves_the_op_of_a_stem_that_rests(seed: int) -> None:
    compensator = HybridMpc(LOOP)
    noise = np.random.default_rng(seed).normal(0.15, 0.2, 1500)
    op, held = 50.0, []
    for k, pv in enumerate(noise):
        # Until then the loop's own controller has moved OP inside the band.
        op = 50.0 + 1.5 * np.sin(k / 20.0) if k < 100 else op
        compensator.observe(float(pv), op)
        if k >= 100:
            op = compensator.decide(0.0).op
            held.append(op)
    assert np.ptp(held[1:]) == 0.0
