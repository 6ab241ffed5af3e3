"""A loop at rest stays at rest: OP changes its place for evidence, not for a tie."""

import numpy as np
import pytest

from compensator import HybridMpc
from loop_model import LoopModel, ProcessModel, ValveModel
from tests.seeds import in_suite

LOOP = LoopModel(ValveModel(8.0, 2.0), ProcessModel((-1.7, 0.72), (0.02, 0.02), 4, 0.0, 1.0))


@pytest.mark.parametrize("seed", in_suite(1, range(4)))
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
