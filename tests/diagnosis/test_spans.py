"""A diagnosis does not hang on the units of OP and PV."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from estimator import EstimatorError
from fieldlink.diagnosis import diagnose
from tests.closed_loop import Loop, run


def noisy() -> Loop:
    return run(noise=2.0, seed=4)


def named(loop: Loop, scale: float, offset: float = 0.0, **more: Any) -> list[str]:
    op = offset + scale * loop.op
    found = diagnose(op, loop.pv, loop.sp, period=1.0, advice=False, figures=False, **more)
    return [str(cause.name) for cause in found.causes]


def test_a_noisy_sensor_shakes_a_valve_of_any_span() -> None:
    loop = noisy()
    assert named(loop, 1.0) == ["sensor"]
    assert loop.op.min() >= 0.0
    assert loop.op.max() <= 100.0
    assert named(loop, 0.01) == ["sensor"]
    assert named(loop, 0.16, 4.0, op_span=16.0) == ["sensor"]
    assert named(loop, -1.0, 100.0) == ["sensor"]


def test_noise_that_hardly_moves_a_valve_is_no_fault_in_any_units() -> None:
    loop = run(gain=0.1, noise=2.0, seed=4)
    assert "sensor" not in named(loop, 1.0)
    assert "sensor" not in named(loop, 0.01)


def test_a_span_is_above_zero() -> None:
    with pytest.raises(EstimatorError, match="op_span is 0"):
        diagnose(np.zeros(100), np.zeros(100), op_span=0.0)
