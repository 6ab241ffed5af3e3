"""A few steps of the load take OP to places of its own: no curve, and no sticky valve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.diagnosis.causes import rank_causes
from estimator.diagnosis.gather import find_swing, gather
from estimator.diagnosis.loop_record import loop_record
from estimator.diagnosis.settings import DIAGNOSIS
from fieldlink.diagnosis import diagnose
from tests.closed_loop import run


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5, 6])
def test_a_straight_process_under_a_few_load_steps_is_not_called_curved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    load = np.repeat(rng.uniform(-25.0, 25.0, 5), 300) + 0.5 * rng.standard_normal(1500)
    loop = run(gain=0.7, load=load, noise=0.05, seed=seed)
    answer = diagnose(loop.op, loop.pv, loop.sp, period=1.0, advice=False)
    assert "characteristic" not in {cause.name for cause in answer.causes}


def test_a_valve_that_makes_a_fiftieth_of_the_motion_is_no_cause() -> None:
    loop = run(band=6.0, jump=4.0, seed=3)
    record = loop_record(loop.op, loop.pv, loop.sp, None, 1.0)
    swing = find_swing(record, DIAGNOSIS)
    found = gather(record, *swing, DIAGNOSIS, valve_is_healthy=False).found
    assert found.explained is not None
    calm = replace(found, swing=replace(found.swing, present=False))
    assert rank_causes(calm, DIAGNOSIS)[0].name == "sticky_valve"
    little = replace(calm, explained=replace(found.explained, effect=0.02))
    (only,) = rank_causes(little, DIAGNOSIS)
    assert only.name == "undetermined"
    assert "sticking makes only 2.0% of PV's variance" in only.evidence[0]
