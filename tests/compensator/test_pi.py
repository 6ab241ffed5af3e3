"""The PI controller against its equation."""

import math

import pytest

from compensator import ActionStatus, CompensatorError, OpLimits, PiController, PiSettings
from fieldlink.lab.study.closed_loop import Study, run
from loop_model import ProcessModel

LAG = ProcessModel((-0.9,), (0.2,), 2, 0.0, 1.0)


def test_a_constant_error_ramps_op_by_gain_over_integral_time() -> None:
    pi = PiController(PiSettings(2.0, 10.0, period=0.5))
    ops = [50.0]
    for _ in range(20):
        pi.observe(9.0, ops[-1])
        ops.append(pi.decide(10.0).op)
    assert ops[1] == pytest.approx(50.0 + 2.0 * 0.5 / 10.0)
    assert ops[-1] == pytest.approx(50.0 + 20 * 2.0 * 0.5 / 10.0)


def test_a_setpoint_step_enters_the_proportional_part() -> None:
    pi = PiController(PiSettings(2.0, 1e9))
    pi.observe(10.0, 50.0)
    pi.decide(10.0)
    pi.observe(10.0, 50.0)
    assert pi.decide(13.0).op == pytest.approx(56.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_reverse_and_direct_action_reach_the_setpoint(sign: float) -> None:
    process = ProcessModel(LAG.a, (sign * 0.2,), 2, 0.0, 1.0)
    pi = PiController(PiSettings(sign * 0.5, 10.0))
    rest = process.gain * 50.0
    trace = run(process, None, pi, Study([(0, rest), (10, rest + 8.0)], 300, load=[(150, 3.0)]))
    assert trace.pv[-1] == pytest.approx(rest + 8.0, abs=1e-3)


def test_it_does_not_wind_up_at_the_limit() -> None:
    pi = PiController(PiSettings(1.0, 5.0, limits=OpLimits(0.0, 60.0)))
    op = 50.0
    for _ in range(200):
        pi.observe(0.0, op)
        action = pi.decide(100.0)
        op = action.op
    assert (op, action.status) == (60.0, ActionStatus.LIMITED)
    pi.observe(101.0, op)
    assert pi.decide(100.0).op < 60.0


def test_take_over_is_bumpless() -> None:
    pi = PiController(PiSettings(5.0, 20.0))
    for pv in (10.0, 30.0, 20.0, 12.0):  # somebody else moves the loop about
        pi.observe(pv, 43.0)
    assert pi.decide(12.0).op == pytest.approx(43.0)


def test_rate_and_bad_pv() -> None:
    pi = PiController(PiSettings(1.0, 1.0, limits=OpLimits(0.0, 100.0, 0.5)))
    pi.observe(0.0, 50.0)
    assert pi.decide(90.0).op == pytest.approx(50.5)
    pi.observe(math.nan, 50.5)
    action = pi.decide(90.0)
    assert (action.op, action.status) == (50.5, ActionStatus.PV_BAD)


def test_a_zero_gain_is_refused() -> None:
    with pytest.raises(CompensatorError, match="gain"):
        PiSettings(0.0, 10.0)
