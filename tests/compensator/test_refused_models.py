"""Which models a supervisor refuses or gives up, and for how long."""

from dataclasses import replace

import numpy as np
import pytest

from compensator import (
    RefusalKind,
    RetrySettings,
    Supervisor,
    SupervisorState,
    UnawareMpc,
    Uncertainty,
    WithdrawReason,
)
from compensator.supervising.given_up import GivenUpModels
from fieldlink.lab.study.closed_loop import EXAMPLE_1
from loop_model import LoopModel, ProcessModel, ValveModel
from tests.compensator.supervised_loop import REST, UNCHECKED, Loop, wrong_sign
from tests.seeds import in_suite


def test_a_refused_first_model_is_flagged() -> None:
    loop = Loop()
    loop.run(5)
    loop.supervisor.offer(LoopModel(ValveModel(150.0, 1.0), EXAMPLE_1.process))
    loop.run(5)
    assert loop.supervisor.state is SupervisorState.BASE
    assert loop.supervisor.reason is WithdrawReason.REFUSED


def test_a_model_that_makes_the_loop_worse_is_given_up() -> None:
    """A process of the wrong sign drives the loop away; the watch must end that."""
    loop = Loop(settings=UNCHECKED)
    loop.run(400)
    wrong = wrong_sign()
    assert loop.supervisor.offer(wrong)
    loop.run(600)
    assert loop.supervisor.state is SupervisorState.BASE
    assert loop.supervisor.reason in {
        WithdrawReason.WORSE,
        WithdrawReason.GROWING,
        WithdrawReason.HUNTING,
        WithdrawReason.LEFT_RANGE,
        WithdrawReason.WRONG_SIGN,
    }
    assert not loop.supervisor.offer(wrong)
    assert "worse" in loop.supervisor.refusal
    assert loop.supervisor.offer(EXAMPLE_1)
    loop.run(400)
    assert loop.supervisor.compensating


def test_a_sign_that_the_record_contradicts_is_refused_at_the_door() -> None:
    loop = Loop()
    loop.run(400)
    wrong = wrong_sign()
    assert not loop.supervisor.offer(wrong)
    assert loop.supervisor.refused is RefusalKind.WRONG_SIGN
    assert "wrong sign" in loop.supervisor.refusal
    assert loop.supervisor.offer(EXAMPLE_1)


def test_the_sign_seen_is_known_after_a_restart() -> None:
    loop = Loop()
    loop.run(400)
    assert loop.supervisor.offer(EXAMPLE_1)
    memory = loop.supervisor.memory
    wrong = wrong_sign()
    loop.supervisor = Supervisor(UnawareMpc(EXAMPLE_1.process))
    loop.supervisor.restore(memory)
    assert not loop.supervisor.offer(wrong)
    assert loop.supervisor.refused is RefusalKind.WRONG_SIGN
    assert loop.supervisor.offer(EXAMPLE_1)


def test_a_wrong_sign_after_manual_trips_at_once() -> None:
    """Manual shortly before the take-over must not make the watch blind."""
    loop = Loop(settings=UNCHECKED)
    loop.run(400)
    loop.run(5, manual=loop.op[-1])
    wrong = wrong_sign()
    assert loop.supervisor.offer(wrong)
    loop.run(400)
    assert loop.supervisor.state is SupervisorState.BASE
    errors = np.abs(np.asarray(loop.pv) - (REST + 2.5))
    far = np.flatnonzero(errors[405:] > 3.0 * errors[100:400].max())
    on = [k for k, state in enumerate(loop.states) if state is SupervisorState.COMPENSATING]
    assert far.size == 0 or on[-1] - (405 + far[0]) <= 40


def test_a_twin_of_a_model_that_was_given_up_is_refused_until_time_has_passed() -> None:
    loop = Loop(settings=replace(UNCHECKED, retry=RetrySettings(after=900)))
    loop.run(400)
    wrong = wrong_sign()
    loop.supervisor.offer(wrong)
    loop.run(300)
    valve = ValveModel.from_friction(7.1, 3.9)
    p = EXAMPLE_1.process
    twin = LoopModel(valve, ProcessModel(p.a, tuple(-1.01 * b for b in p.b), 1, 0.0, 1.0))
    assert not loop.supervisor.offer(twin)
    memory = loop.supervisor.memory
    other = Loop()
    other.supervisor.restore(memory)
    assert not other.supervisor.offer(twin)
    assert other.supervisor.memory.figures == memory.figures
    loop.run(900)
    assert loop.supervisor.offer(twin)


def test_each_further_model_that_is_given_up_makes_any_wait_twice_as_long() -> None:
    models = GivenUpModels(RetrySettings(after=1000, pause=100))
    process = EXAMPLE_1.process
    waits = []
    for band in (4.0, 8.0, 16.0, 32.0):  # no two of them are alike
        model = LoopModel(ValveModel(band, 0.4 * band), process)
        assert models.find(model) is None
        models.add(model, Uncertainty(), RefusalKind.WORSE)
        waits.append(models.pause)
    assert waits == [0, 100, 200, 400]
    for _ in range(400):
        assert models.pause
        models.pass_scan()
    assert models.pause == 0
    other = GivenUpModels(models.settings)
    other.add(LoopModel(ValveModel(5.0, 2.0), process), Uncertainty(), RefusalKind.WORSE)
    assert other.pause == 0
    other.restore((*models.known, *other.known))  # a restart lets none pass
    assert other.pause == 800


@pytest.mark.parametrize("seed", range(3))
def test_no_third_model_is_tried_at_once_where_two_that_differ_made_the_loop_worse(
    seed: int,
) -> None:
    loop = Loop(seed, settings=UNCHECKED)
    loop.run(400)
    p = EXAMPLE_1.process
    for factor in (-1.0, -1.6):
        wrong = ProcessModel(p.a, tuple(factor * b for b in p.b), 1, 0.0, 1.0)
        assert loop.supervisor.offer(LoopModel(EXAMPLE_1.valve, wrong))
        loop.run(400)
        assert loop.supervisor.state is SupervisorState.BASE
    third = ProcessModel(p.a, tuple(-2.6 * b for b in p.b), 1, 0.0, 1.0)
    assert not loop.supervisor.offer(LoopModel(EXAMPLE_1.valve, third))
    assert "2 models that differ" in loop.supervisor.refusal
    assert loop.supervisor.refused is not RefusalKind.NONE


def test_a_valve_that_does_not_stick_is_refused() -> None:
    loop = Loop()
    loop.run(50)
    assert not loop.supervisor.offer(LoopModel(ValveModel(0.0, 0.0), EXAMPLE_1.process))
    assert "stick band is 0" in loop.supervisor.refusal


@pytest.mark.parametrize("seed", in_suite(2, range(5)))
def test_a_valve_model_far_too_small_ends_well_or_is_given_up_where_no_record_corrects_it(
    seed: int,
) -> None:
    loop = Loop(seed, settings=UNCHECKED)
    loop.run(600)
    valve = EXAMPLE_1.valve
    wrong = ValveModel(0.3 * valve.stick_band, 0.3 * valve.slip_jump)
    assert loop.supervisor.offer(LoopModel(wrong, EXAMPLE_1.process))
    loop.run(1200)
    if loop.supervisor.state is SupervisorState.COMPENSATING:
        assert np.std(loop.pv[-600:]) <= 0.5 * np.std(loop.pv[300:600])
        assert np.ptp(loop.stem[-600:]) == 0.0
        return
    assert loop.supervisor.state is SupervisorState.BASE
    assert loop.supervisor.reason in {
        WithdrawReason.WORSE,
        WithdrawReason.HUNTING,
        WithdrawReason.GROWING,
        WithdrawReason.TRAVEL,
        WithdrawReason.NO_GAIN,
    }
