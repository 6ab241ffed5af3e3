"""Settings of the running controller, read off records of simulated loops."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from estimator.controller.shifts import find_shift
from fieldlink.diagnosis import read_controller
from tests.closed_loop import Loop, run
from tests.seeds import in_suite


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


@pytest.mark.parametrize("fastest", [0.5, 0.3, 0.2])
def test_samples_in_which_op_moves_as_fast_as_it_may_do_not_count(fastest: float) -> None:
    """Increments of a PI controller, limited to so much a scan, in 4 to 40 % of the scans."""
    rng = np.random.default_rng(1)
    pushes = lfilter([0.3], [1.0, -0.98], rng.standard_normal(3000))
    op, pv = np.empty(3000), np.empty(3000)
    y = u = last = 0.0
    late = [0.0] * 4
    for k in range(3000):
        pv[k] = y + 0.05 * rng.standard_normal()
        move = 3.0 * (-pv[k] - last - pv[k] / 20.0)
        u += float(np.clip(move, -fastest, fastest))
        last, op[k] = -pv[k], u
        late.append(u)
        y += (0.8 * (late.pop(0) + pushes[k]) - y) / 20.0
    found = read_controller(50.0 + op, 50.0 + pv, np.full(3000, 50.0))
    assert found is not None
    assert found.exact
    assert found.gain == pytest.approx(3.0, rel=0.01)
    assert found.integral_time_s == pytest.approx(20.0, rel=0.01)


def test_a_constant_op_has_no_controller() -> None:
    pv = np.random.default_rng(0).standard_normal(500)
    assert read_controller(np.full(500, 40.0), pv) is None


def answers(loop: Loop, *, filtered: str, derivative: float = 0.0, pole: float = 0.6) -> np.ndarray:
    """OP of a PI or PID controller with a filter on PV or on its derivative alone, ``(n,)``."""
    gain, integral_time = 0.8, 12.0
    op = np.empty(loop.pv.size)
    integral, slope = 50.0, 0.0
    seen = before = loop.pv[0]
    for k, (target, pv) in enumerate(zip(loop.sp, loop.pv, strict=True)):
        seen = pole * seen + (1.0 - pole) * pv if filtered == "pv" else pv
        integral += gain / integral_time * (target - seen)
        kept = pole if filtered == "derivative" else 0.0
        slope = kept * slope - (1.0 - kept) * gain * derivative * (seen - before)
        op[k] = gain * (target - seen) + integral + slope
        before = seen
    return op


@pytest.mark.parametrize("seed", in_suite(8, range(1, 21)))
@pytest.mark.parametrize(("filtered", "derivative"), [("pv", 0.0), ("derivative", 3.0)])
def test_a_filter_beside_set_point_steps_hides_no_settings(
    filtered: str, derivative: float, seed: int
) -> None:
    loop = run(sp=np.repeat([0.0, 4.0, -2.0, 3.0, 1.0], 300), noise=0.1, seed=seed)
    op = answers(loop, filtered=filtered, derivative=derivative)
    found = read_controller(op, loop.pv, loop.sp, period=2.0)
    assert found is not None
    assert found.exact
    assert found.filter_on == filtered
    assert found.gain == pytest.approx(0.8, rel=0.01)
    assert found.integral_time_s == pytest.approx(24.0, rel=0.01)
    assert found.derivative_time_s == pytest.approx(2.0 * derivative, rel=0.01)
    assert found.filter_time_s == pytest.approx(-2.0 / np.log(0.6), rel=0.01)


@pytest.mark.parametrize("seed", in_suite(8, range(1, 21)))
def test_the_mean_of_several_scans_is_not_what_the_controller_saw(seed: int) -> None:
    loop = run(noise=0.1, n=4500, seed=seed)
    op, pv, sp = (one.reshape(-1, 3).mean(axis=1) for one in (loop.op, loop.pv, loop.sp))
    found = read_controller(op, pv, sp, period=3.0)
    assert found is not None
    assert not found.exact


@pytest.mark.parametrize("seed", range(1, 21))
def test_rounding_of_the_record_leaves_settings_exact(seed: int) -> None:
    loop = run(noise=0.3, seed=seed)
    found = read_controller(np.round(loop.op, 2), np.round(loop.pv, 3), loop.sp)
    assert found is not None
    assert found.exact
    assert found.integral_time_s == pytest.approx(12.0, rel=0.05)


@pytest.mark.parametrize("late", [-3, -2, 2, 3])
def test_samples_that_belong_together_show_through_noise(late: int) -> None:
    right = 0
    for seed in range(1, 21):
        loop = run(noise=0.1, n=1000, seed=seed)
        op, pv = np.roll(loop.op, max(0, -late)), np.roll(loop.pv, max(0, late))
        drawn = np.random.default_rng(seed).standard_normal((2, op.size))
        op, pv = op + 0.02 * op.std() * drawn[0], pv + 0.02 * pv.std() * drawn[1]
        assert find_shift(loop.op + 0.02 * op.std() * drawn[0], loop.pv, loop.sp, 1.0) == 0
        right += find_shift(op, pv, loop.sp, 1.0) == late
    assert right >= 19


def test_a_process_that_answers_at_once_is_no_controller_that_is_late() -> None:
    for seed in range(1, 21):
        rng = np.random.default_rng(seed)
        op = 50.0 + np.cumsum(rng.standard_normal(800))
        op -= np.linspace(0.0, op[-1] - 50.0, 800)
        for pole in (0.0, 0.5):
            pv = lfilter([0.0, 1.0 - pole], [1.0, -pole], op - 50.0)
            assert find_shift(op, pv + 0.1 * rng.standard_normal(800), None) == 0
            assert find_shift(op, pv + 0.1 * rng.standard_normal(800), None, 1.0) == 0


@pytest.mark.parametrize("size", [1e-320, 1e-310, 1e-160, 1e160, 1e300])
def test_values_that_nobody_can_have_measured_have_no_controller(size: float) -> None:
    """So look floats whose registers are in the other order; warnings are errors here."""
    pv = np.cumsum(np.random.default_rng(1).normal(size=400))
    op = 50.0 - 0.5 * pv - 0.02 * np.cumsum(pv)
    assert read_controller(op, pv, np.zeros(400)) is not None
    assert read_controller(op, size * pv, np.zeros(400)) is None
    assert read_controller(op, size * pv) is None
