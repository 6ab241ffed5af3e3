"""A device that was away for most of a window: what is not there is no finding about the loop."""

from __future__ import annotations

import numpy as np
import pytest

from fieldlink.diagnosis import CauseName, diagnose
from tests.closed_loop import run


@pytest.mark.parametrize("read", [17, 60])
def test_a_device_that_was_away_is_no_fault_of_pv_and_no_limit_of_op(read: int) -> None:
    wrong = {CauseName.SENSOR, CauseName.SATURATION, CauseName.MANUAL}
    for seed in range(6):
        loop = run(n=300, seed=seed)
        begin = 40 + 30 * seed
        there = np.zeros(300, dtype=bool)
        there[begin : begin + read] = True
        op, pv, sp = (np.where(there, x, np.nan) for x in (loop.op, loop.pv, loop.sp))
        found = diagnose(op, pv, sp, auto=np.ones(300), advice=False, valve_is_healthy=True)
        assert wrong.isdisjoint(cause.name for cause in found.causes)


def test_a_limit_is_found_beside_a_time_without_samples() -> None:
    loop = run(n=600, seed=3, limits=(0.0, 50.0))
    gone = slice(200, 300)
    op, pv, sp = (np.array(x, dtype=float) for x in (loop.op, loop.pv, loop.sp))
    for values in (op, pv, sp):
        values[gone] = np.nan
    found = diagnose(op, pv, sp, advice=False, valve_is_healthy=True)
    assert CauseName.SATURATION in [cause.name for cause in found.causes]
