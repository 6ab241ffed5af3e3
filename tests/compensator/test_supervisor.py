"""Take-over, fall-back and change of model: bumpless, never while the valve moves, and flagged."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from compensator import (
    ActionStatus,
    EmbeddingMpc,
    EmbeddingSettings,
    Supervisor,
    SupervisorSettings,
    SupervisorState,
    UnawareMpc,
    WithdrawReason,
)
from fieldlink.lab.study.closed_loop import EXAMPLE_1, Plant
from loop_model import LoopModel, ProcessModel, ValveModel
from tests.compensator.supervised_loop import REST, Loop

Event = Callable[[Supervisor], object]


@pytest.fixture
def compensated() -> Loop:
    loop = Loop()
    loop.run(400)
    loop.supervisor.offer(EXAMPLE_1)
    loop.run(400)
    return loop


def switches(loop: Loop) -> list[int]:
    compensating = [state is SupervisorState.COMPENSATING for state in loop.states]
    return [int(k) for k in np.flatnonzero(np.diff(np.asarray(compensating, dtype=int))) + 1]


def test_the_oscillation_stops_after_take_over(compensated: Loop) -> None:
    assert compensated.std(450) < 0.35 * compensated.std(50, 400)
    assert compensated.supervisor.compensating
    assert compensated.supervisor.reason is WithdrawReason.NONE


def test_take_over_waits_for_rest_and_does_not_touch_op(compensated: Loop) -> None:
    (k,) = switches(compensated)
    assert 400 <= k < 440
    assert compensated.op[k + 1] == compensated.op[k]
    assert compensated.stem[k + 1] == compensated.stem[k] == compensated.stem[k - 1]


def test_a_set_point_that_ramps_out_of_reach_and_back_gives_up_no_model(compensated: Loop) -> None:
    """It goes 70 beyond the first, where OP allows 45, stays for 220 scans and comes back."""
    sp, farthest = REST + 2.5, 0.0
    for k in range(900):
        sp += 0.25 if k < 280 else -0.25 if 500 <= k < 780 else 0.0
        compensated.run(1, sp)
        farthest = max(farthest, sp - compensated.pv[-1])
    assert farthest > 20.0
    assert compensated.supervisor.compensating
    assert compensated.supervisor.reason is WithdrawReason.NONE
    assert abs(compensated.pv[-1] - sp) < 0.5


@pytest.mark.parametrize(
    "reason",
    [WithdrawReason.EXPIRED, WithdrawReason.HEARTBEAT_DEAD, WithdrawReason.OPERATOR],
)
def test_a_withdrawn_model_gives_the_loop_back_smoothly(
    compensated: Loop, reason: WithdrawReason
) -> None:
    before = compensated.op[-1]
    compensated.supervisor.withdraw(reason)
    compensated.run(1)
    assert compensated.supervisor.state is SupervisorState.BASE
    assert compensated.supervisor.reason is reason
    # The base controller has followed: it asks for what PV's deviation asks for, no more.
    assert abs(compensated.op[-1] - before) < 3.0
    compensated.run(400, sp=REST - 2.5)
    assert compensated.std(-300) > 0.5


def test_a_newer_model_changes_the_frictions_at_the_limited_rate(compensated: Loop) -> None:
    first = len(compensated.frictions)
    assert compensated.supervisor.offer(
        LoopModel(ValveModel.from_friction(7.6, 4.4), EXAMPLE_1.process)
    )
    compensated.run(200)
    changes = np.abs(np.diff(compensated.frictions[first - 1 :], axis=0))
    assert changes.max() <= 0.05 + 1e-9
    assert compensated.frictions[-1] == pytest.approx((7.6, 4.4))


def test_the_frictions_do_not_change_while_the_valve_moves(compensated: Loop) -> None:
    compensated.supervisor.offer(LoopModel(ValveModel.from_friction(7.9, 4.6), EXAMPLE_1.process))
    first = len(compensated.pv)
    compensated.run(60, sp=REST + 9.0)
    frictions = np.asarray(compensated.frictions[-60:])
    changed = np.flatnonzero(np.abs(np.diff(frictions, axis=0)).max(axis=1) > 0.0) + 1 + first
    moved = np.flatnonzero(np.abs(np.diff(compensated.stem)) > 0.0)
    assert moved.size
    assert not set(changed.tolist()) & {int(k) + 1 for k in moved if k >= first}


def test_another_process_is_taken_over_bumplessly(compensated: Loop) -> None:
    pole = math.exp(-1.0 / 8.5)
    process = ProcessModel((-pole,), (1.0 - pole,), 5, 0.0, 1.0)
    before = compensated.op[-1]
    assert compensated.supervisor.offer(LoopModel(EXAMPLE_1.valve, process))
    compensated.run(1)
    assert compensated.op[-1] == pytest.approx(before)
    compensated.run(300)
    assert compensated.supervisor.model == LoopModel(EXAMPLE_1.valve, process)
    assert compensated.std(-200) < 0.5 * compensated.std(50, 400)


def test_a_useless_model_is_refused_and_the_good_one_kept(compensated: Loop) -> None:
    hopeless = LoopModel(EXAMPLE_1.valve, ProcessModel((-1.3,), (0.1,), 1, 0.0, 1.0))
    assert not compensated.supervisor.offer(hopeless)
    assert "unstable" in compensated.supervisor.refusal
    assert compensated.supervisor.compensating
    too_wide = LoopModel(ValveModel(120.0, 1.0), EXAMPLE_1.process)
    assert not compensated.supervisor.offer(too_wide)
    assert "stick band of 120" in compensated.supervisor.refusal


def test_bad_pv_holds_then_falls_back_then_returns(compensated: Loop) -> None:
    held = compensated.op[-1]
    compensated.run(8, bad=True)
    assert set(compensated.op[-8:]) == {held}
    assert compensated.actions[-1].status is ActionStatus.PV_BAD
    compensated.run(10, bad=True)
    assert compensated.supervisor.reason is WithdrawReason.PV_BAD
    assert not compensated.supervisor.compensating
    assert set(compensated.op[-18:]) == {held}
    compensated.run(200)
    assert compensated.supervisor.compensating
    assert compensated.supervisor.reason is WithdrawReason.NONE


def test_manual_and_back_without_a_jump(compensated: Loop) -> None:
    compensated.run(20, manual=compensated.op[-1])
    assert compensated.supervisor.state is SupervisorState.MANUAL
    before = compensated.op[-1]
    compensated.run(1)
    assert compensated.op[-1] == pytest.approx(before)
    compensated.run(200)
    assert compensated.supervisor.compensating
    assert compensated.std(-150) < 0.5 * compensated.std(50, 400)


def test_a_frozen_pv_differs_from_a_quiet_one(compensated: Loop) -> None:
    frozen = compensated.plant.pv
    held = None
    for _ in range(60):
        action = compensated.supervisor.step(frozen, REST + 2.5, compensated.op[-1])
        held = action.op if held is None or action.status is not ActionStatus.PV_BAD else held
        compensated.op.append(action.op)
    assert compensated.supervisor.reason is WithdrawReason.PV_FROZEN
    assert not compensated.supervisor.compensating
    assert compensated.op[-1] == held
    compensated.run(200)
    assert compensated.supervisor.compensating
    assert compensated.supervisor.reason is WithdrawReason.NONE


def test_a_solver_that_keeps_passing_its_bound_is_given_up() -> None:
    pytest.importorskip("casadi")
    supervisor = Supervisor(
        UnawareMpc(EXAMPLE_1.process),
        build=lambda model, _: EmbeddingMpc(model, EmbeddingSettings(max_iterations=1)),
    )
    plant = Plant(EXAMPLE_1.process, EXAMPLE_1.valve, 50.0)
    supervisor.offer(EXAMPLE_1)
    op, ops, failed = 50.0, [], 0
    for _ in range(60):
        action = supervisor.step(plant.pv, REST, op)
        failed += action.status is ActionStatus.SOLVER_FAILED
        op = action.op
        ops.append(op)
        plant.step(op)
    assert failed == SupervisorSettings().solver_limit
    assert supervisor.state is SupervisorState.WAITING
    assert supervisor.reason is WithdrawReason.SOLVER
    # Bumpless: held while the solver failed, and the base goes on from there.
    assert np.abs(np.diff(ops)).max() < 1.0
    for _ in range(600):  # three pauses of a horizon later it is given up
        op = supervisor.step(plant.pv, REST, op).op
        plant.step(op)
    assert supervisor.state is SupervisorState.BASE
    assert supervisor.reason is WithdrawReason.SOLVER
