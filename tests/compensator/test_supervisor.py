"""Take-over, fall-back and change of model: bumpless, never while the valve moves, and flagged."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from compensator import (
    Action,
    ActionStatus,
    EmbeddingMpc,
    EmbeddingSettings,
    LoopFigures,
    RefusalKind,
    RetrySettings,
    Supervisor,
    SupervisorSettings,
    SupervisorState,
    UnawareMpc,
    WithdrawReason,
)
from compensator.figures import oscillation_period
from compensator.record_check import RecordCheckSettings
from compensator.watch import LoopWatch, Watched, WatchVerdict
from fieldlink.lab.study.closed_loop import EXAMPLE_1, Plant
from loop_model import LoopModel, ProcessModel, ValveModel

REST = EXAMPLE_1.process.gain * 50.0
Event = Callable[[Supervisor], object]
UNCHECKED = SupervisorSettings(check=RecordCheckSettings(shortest=10**6))
"""For tests of the watch: the record refuses no model beforehand."""


class Loop:
    """Example 1 under a supervisor, with everything it did on record."""

    def __init__(self, seed: int = 4, settings: SupervisorSettings | None = None) -> None:
        self.supervisor = Supervisor(UnawareMpc(EXAMPLE_1.process), settings)
        self.plant = Plant(EXAMPLE_1.process, EXAMPLE_1.valve, 50.0, 48.0)
        self.noise = np.random.default_rng(seed).normal(0.0, 0.01, 5000)
        self.pv: list[float] = []
        self.op: list[float] = [50.0]
        self.stem: list[float] = [48.0]
        self.states: list[SupervisorState] = []
        self.frictions: list[tuple[float, float]] = []
        self.actions: list[Action] = []

    def run(
        self,
        samples: int,
        sp: float = REST + 2.5,
        *,
        bad: bool = False,
        manual: float | None = None,
    ) -> None:
        for _ in range(samples):
            pv = self.plant.pv
            action = self.supervisor.step(
                math.nan if bad else pv, sp, self.op[-1], automatic=manual is None
            )
            op = action.op if manual is None else manual
            self.plant.step(op, float(self.noise[len(self.pv)]))
            self.pv.append(pv)
            self.op.append(op)
            self.stem.append(self.plant.stem)
            self.states.append(self.supervisor.state)
            self.actions.append(action)
            model = self.supervisor.model
            if model is not None:
                valve = model.valve
                self.frictions.append((valve.static_friction, valve.dynamic_friction))

    def std(self, start: int, stop: int | None = None) -> float:
        return float(np.std(self.pv[start:stop]))


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


def test_a_refused_first_model_is_flagged() -> None:
    loop = Loop()
    loop.run(5)
    loop.supervisor.offer(LoopModel(ValveModel(150.0, 1.0), EXAMPLE_1.process))
    loop.run(5)
    assert loop.supervisor.state is SupervisorState.BASE
    assert loop.supervisor.reason is WithdrawReason.REFUSED


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


def test_a_model_that_makes_the_loop_worse_is_given_up() -> None:
    """A process of the wrong sign drives the loop away; the watch must end that."""
    loop = Loop(settings=UNCHECKED)
    loop.run(400)
    p = EXAMPLE_1.process
    wrong = LoopModel(EXAMPLE_1.valve, ProcessModel(p.a, tuple(-b for b in p.b), 1, 0.0, 1.0))
    assert loop.supervisor.offer(wrong)
    loop.run(600)
    assert loop.supervisor.state is SupervisorState.BASE
    assert loop.supervisor.reason in {
        WithdrawReason.WORSE,
        WithdrawReason.GROWING,
        WithdrawReason.HUNTING,
        WithdrawReason.LEFT_RANGE,
    }
    assert not loop.supervisor.offer(wrong)
    assert "worse" in loop.supervisor.refusal
    assert loop.supervisor.offer(EXAMPLE_1)
    loop.run(400)
    assert loop.supervisor.compensating


def test_a_sign_that_the_record_contradicts_is_refused_at_the_door() -> None:
    loop = Loop()
    loop.run(400)
    p = EXAMPLE_1.process
    wrong = LoopModel(EXAMPLE_1.valve, ProcessModel(p.a, tuple(-b for b in p.b), 1, 0.0, 1.0))
    assert not loop.supervisor.offer(wrong)
    assert loop.supervisor.refused is RefusalKind.WRONG_SIGN
    assert "wrong sign" in loop.supervisor.refusal
    assert loop.supervisor.offer(EXAMPLE_1)


def test_the_sign_seen_is_known_after_a_restart() -> None:
    loop = Loop()
    loop.run(400)
    assert loop.supervisor.offer(EXAMPLE_1)
    memory = loop.supervisor.memory
    p = EXAMPLE_1.process
    wrong = LoopModel(EXAMPLE_1.valve, ProcessModel(p.a, tuple(-b for b in p.b), 1, 0.0, 1.0))
    loop.supervisor = Supervisor(UnawareMpc(p))
    loop.supervisor.restore(memory)
    assert not loop.supervisor.offer(wrong)
    assert loop.supervisor.refused is RefusalKind.WRONG_SIGN
    assert loop.supervisor.offer(EXAMPLE_1)


def test_a_wrong_sign_after_manual_trips_at_once() -> None:
    """Manual shortly before the take-over must not make the watch blind."""
    loop = Loop(settings=UNCHECKED)
    loop.run(400)
    p = EXAMPLE_1.process
    loop.run(5, manual=loop.op[-1])
    wrong = LoopModel(EXAMPLE_1.valve, ProcessModel(p.a, tuple(-b for b in p.b), 1, 0.0, 1.0))
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
    p = EXAMPLE_1.process
    wrong = LoopModel(EXAMPLE_1.valve, ProcessModel(p.a, tuple(-b for b in p.b), 1, 0.0, 1.0))
    loop.supervisor.offer(wrong)
    loop.run(300)
    valve = ValveModel.from_friction(7.1, 3.9)
    twin = LoopModel(valve, ProcessModel(p.a, tuple(-1.01 * b for b in p.b), 1, 0.0, 1.0))
    assert not loop.supervisor.offer(twin)
    memory = loop.supervisor.memory
    other = Loop()
    other.supervisor.restore(memory)
    assert not other.supervisor.offer(twin)
    assert other.supervisor.memory.figures == memory.figures
    loop.run(900)
    assert loop.supervisor.offer(twin)


def test_a_valve_that_does_not_stick_is_refused() -> None:
    loop = Loop()
    loop.run(50)
    assert not loop.supervisor.offer(LoopModel(ValveModel(0.0, 0.0), EXAMPLE_1.process))
    assert "stick band is 0" in loop.supervisor.refusal


def test_a_valve_model_far_too_small_is_given_up_where_no_record_corrects_it() -> None:
    loop = Loop(settings=UNCHECKED)
    loop.run(600)
    valve = EXAMPLE_1.valve
    wrong = ValveModel(0.3 * valve.stick_band, 0.3 * valve.slip_jump)
    assert loop.supervisor.offer(LoopModel(wrong, EXAMPLE_1.process))
    loop.run(1200)
    assert loop.supervisor.state is SupervisorState.BASE
    assert loop.supervisor.reason in {
        WithdrawReason.WORSE,
        WithdrawReason.HUNTING,
        WithdrawReason.GROWING,
    }


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


def test_a_growing_oscillation_is_noticed_within_five_periods() -> None:
    period, growth = 40, 1.3
    watch = LoopWatch(LoopFigures(0.04, 0.1, 100.0, 0.6))
    noise = np.random.default_rng(1).normal(0.0, 0.1, 20 * period)
    for k in range(20 * period):
        error = 0.5 * growth ** (k / period) * math.sin(2.0 * math.pi * k / period) + noise[k]
        if watch.push(Watched(error, 0.0, 0.01)) is not WatchVerdict.FINE:
            break
    # It begins at five deviations of the noise.
    assert k < 5 * period


def test_an_oscillation_worse_than_before_is_noticed_within_five_periods() -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2))
    for k in range(400):
        verdict = watch.push(Watched(1.05 * math.sin(2.0 * math.pi * k / 40.0), 0.8, 0.01))
        if verdict is not WatchVerdict.FINE:
            break
    assert verdict is WatchVerdict.WORSE
    assert k < 5 * 40


@pytest.mark.parametrize("amplitude", [0.9, 0.3])
def test_a_steady_oscillation_no_worse_than_before_is_let_be(amplitude: float) -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2))
    noise = np.random.default_rng(2).normal(0.0, 0.1, 2000)
    for k in range(2000):
        error = amplitude * math.sin(2.0 * math.pi * k / 40.0) + noise[k]
        assert watch.push(Watched(error, 0.5, 0.01)) is WatchVerdict.FINE


def test_the_period_is_read_from_the_error() -> None:
    noise = np.random.default_rng(3).normal(0.0, 0.2, 600)
    errors = [math.sin(2.0 * math.pi * k / 60.0) + noise[k] for k in range(600)]
    assert oscillation_period(errors, 1.0) == pytest.approx(60.0, rel=0.05)
    assert oscillation_period([0.1, 0.2, 0.3], 77.0) == 77.0


def test_what_was_seen_before_a_set_point_change_still_counts() -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2))
    seen = 0
    for k in range(1000):
        if k % 70 == 0:
            watch.restart(20)
        seen += 1
        if (
            watch.push(Watched(1.1 * math.sin(2.0 * math.pi * k / 40.0), 0.8, 0.01))
            is WatchVerdict.WORSE
        ):
            break
    assert seen < 8 * 40


def test_an_overshoot_as_large_as_the_step_ends_it_at_once() -> None:
    watch = LoopWatch(LoopFigures(0.02, 1.0, 40.0, 2.0))
    watch.restart(60)
    for k in range(60):
        verdict = watch.push(Watched(-5.0 + 0.25 * k, 0.0, 0.0025))
        if verdict is not WatchVerdict.FINE:
            break
    assert verdict is WatchVerdict.GROWING
    assert k == 41


def test_an_error_far_beyond_all_that_was_known_ends_it_within_the_dead_time_and_eight() -> None:
    watch = LoopWatch(LoopFigures(0.02, 1.0, 40.0, 0.4), dead_time=5)
    for k in range(60):
        verdict = watch.push(Watched(0.1 * k, 0.0, 0.0025))
        if verdict is not WatchVerdict.FINE:
            break
    assert verdict is WatchVerdict.LEFT_RANGE
    assert k == 13 + 12  # beyond 1.2 from sample 13 on


def test_an_error_that_returns_is_none_that_ran_away() -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2))
    for k in range(300):
        error = 5.0 * math.exp(-((k - 100.0) ** 2) / 18.0)
        assert watch.push(Watched(error, 0.0, 0.01)) is WatchVerdict.FINE


def test_op_at_its_limit_with_pv_leaving_ends_it() -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2), dead_time=1)
    for k in range(60):
        verdict = watch.push(Watched(1.0 + 0.05 * k, 0.0, 0.01, limited=True, at_limit=True))
        if verdict is not WatchVerdict.FINE:
            break
    assert verdict is WatchVerdict.LEFT_RANGE
    assert 1.0 + 0.05 * k < 3.0 * 1.2


def test_a_set_point_out_of_reach_is_not_worse() -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2))
    watch.restart(40)
    for _ in range(1000):
        assert (
            watch.push(Watched(-5.0, 0.0, 0.01, limited=True, at_limit=True)) is WatchVerdict.FINE
        )


def test_travel_over_its_budget_is_noticed_however_good_pv_is() -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2), stroke=10.0)
    found = [watch.push(Watched(0.05, 2.5, 1e-4)) for _ in range(300)]
    assert WatchVerdict.TRAVEL in found
    fair = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2), stroke=10.0)
    assert all(fair.push(Watched(0.05, 1.9, 1e-4)) is WatchVerdict.FINE for _ in range(300))
    ramp = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2), stroke=10.0)
    asked = [ramp.push(Watched(0.05, 2.5, 1e-4, sp_travel=1.0)) for _ in range(300)]
    assert set(asked) == {WatchVerdict.FINE}
    # A stem follows a ramp in steps: what each step does is what the scans before it asked for.
    steps = LoopWatch(LoopFigures(0.5, 0.02, 40.0, 1.2), stroke=1.0)
    found = [
        steps.push(Watched(0.05, 5.0 * (k % 25 == 24), 1e-4, sp_travel=0.2)) for k in range(300)
    ]
    assert set(found) == {WatchVerdict.FINE}


def test_a_valve_at_rest_is_given_more_room() -> None:
    """What PV does then is noise: 1.5 times the mean square of before is no reason to give up."""
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2))
    for k in range(2000):
        error = math.sqrt(1.5) * math.sin(2.0 * math.pi * k / 40.0)
        assert watch.push(Watched(error, 0.0, 0.2)) is WatchVerdict.FINE
    errors = [3.5 * math.sin(2.0 * math.pi * k / 40.0) for k in range(260)]
    assert any(watch.push(Watched(e, 0.0, 0.2)) is WatchVerdict.WORSE for e in errors)
