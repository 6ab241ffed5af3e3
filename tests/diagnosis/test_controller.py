"""Settings of the running controller, read off records of simulated loops."""

from __future__ import annotations

import numpy as np
import pytest

from fieldlink.diagnosis import read_controller
from tests.closed_loop import run


@pytest.mark.parametrize(("gain", "process_gain"), [(0.8, 1.5), (-0.8, -1.5)])
def test_pi_settings_are_exact_on_what_the_controller_saw(gain: float, process_gain: float) -> None:
    loop = run(gain=gain, process_gain=process_gain, noise=0.1)
    found = read_controller(loop.op, loop.pv, loop.sp, period=5.0)
    assert found is not None
    assert (found.structure, found.exact) == ("PI", True)
    assert found.gain == pytest.approx(gain, rel=0.01)
    assert found.integral_time_s == pytest.approx(60.0, rel=0.01)
    assert found.action == ("reverse" if gain > 0.0 else "direct")


def test_derivative_action_is_reported() -> None:
    loop = run(derivative_time=2.5, noise=0.1)
    found = read_controller(loop.op, loop.pv, loop.sp, period=2.0)
    assert found is not None
    assert found.structure == "PID"
    assert found.derivative_time_s == pytest.approx(5.0, rel=0.05)


def test_settings_through_noise_of_the_record() -> None:
    loop = run(band=5.0, jump=2.0, n=2000)
    rng = np.random.default_rng(5)
    op = loop.op + 0.05 * loop.op.std() * rng.standard_normal(loop.op.size)
    pv = loop.pv + 0.05 * loop.pv.std() * rng.standard_normal(loop.pv.size)
    found = read_controller(op, pv, loop.sp)
    assert found is not None
    assert found.gain == pytest.approx(0.8, rel=0.15)
    assert found.integral_time_s == pytest.approx(12.0, rel=0.15)


def test_samples_at_a_limit_do_not_count() -> None:
    push = -3.0 * np.sin(2.0 * np.pi * np.arange(1500) / 300.0)
    loop = run(noise=0.1, load=push, limits=(0.0, 51.0))
    found = read_controller(loop.op, loop.pv, loop.sp)
    assert found is not None
    assert found.exact
    assert found.integral_time_s == pytest.approx(12.0, rel=0.01)


def test_a_constant_op_has_no_controller() -> None:
    pv = np.random.default_rng(0).standard_normal(500)
    assert read_controller(np.full(500, 40.0), pv) is None
