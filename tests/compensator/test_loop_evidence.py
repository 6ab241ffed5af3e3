"""What the compensator learns of a loop: sign, rounding, noise at rest, ramps; slow stems."""

from __future__ import annotations

import math

import numpy as np
import pytest

from compensator import (
    CompensatorError,
    HybridMpc,
    HybridSettings,
    PiController,
    PiSettings,
    Supervisor,
    WithdrawReason,
)
from compensator.hybrid.moves import LeastMoves, MovePlanner
from compensator.hybrid.setpoint_trend import SetpointTrend, SetpointTrendSettings
from compensator.hybrid.thrift import Thrift, ThriftSettings
from compensator.prediction import Prediction
from compensator.stem_tracking.fluctuation import RestFluctuation
from compensator.stem_tracking.resolution import PvResolution
from compensator.supervising.record_check import RecordCheckSettings, seen_agreement, seen_friction
from compensator.supervising.screen import PvScreen
from loop_model import LoopModel, ProcessModel, ValveModel

LAG = ProcessModel((-0.9,), (0.1,), 3, 0.0, 1.0)
MODEL = LoopModel(ValveModel(6.0, 2.0), LAG)


def limit_cycle(samples: int, seed: int = 1) -> tuple[list[float], list[float]]:
    """Return OP and PV of a PI loop whose valve sticks."""
    noise = np.random.default_rng(seed).normal(0.0, 0.02, samples)
    pi = PiController(PiSettings(1.2, 9.0))
    stem, op, pv = 49.0, 50.0, 49.0
    late = [49.0] * LAG.dead_time
    ops, pvs = [], []
    for k in range(samples):
        seen = pv + noise[k]
        ops.append(op)
        pvs.append(seen)
        pi.observe(seen, op)
        op = pi.decide(50.0).op
        stem = MODEL.valve.step(stem, op)
        late.append(stem)
        pv = 0.9 * pv + 0.1 * late.pop(0)
    return ops, pvs


def with_gain(factor: float) -> LoopModel:
    return LoopModel(MODEL.valve, ProcessModel(LAG.a, (0.1 * factor,), 3, 0.0, 1.0))


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_a_limit_cycle_bears_out_the_right_sign_whatever_the_gain(factor: float) -> None:
    ops, pvs = limit_cycle(400)
    assert seen_agreement(with_gain(factor), ops, pvs) == 1
    assert seen_agreement(with_gain(-factor), ops, pvs) == -1


def test_a_short_or_bad_record_says_nothing_of_the_sign() -> None:
    ops, pvs = limit_cycle(400)
    assert seen_agreement(with_gain(-1.0), ops[:100], pvs[:100]) == 0
    assert seen_agreement(with_gain(-1.0), ops, [math.nan] * len(ops)) == 0
    assert seen_agreement(with_gain(-1.0), [50.0] * 400, pvs) == 0
    with pytest.raises(CompensatorError, match="clear is a correlation between 0 and 1"):
        RecordCheckSettings(clear=1.5)


def with_valve(factor: float) -> LoopModel:
    valve = MODEL.valve
    return LoopModel(ValveModel(factor * valve.stick_band, factor * valve.slip_jump), LAG)


def test_a_record_shows_a_friction_plainly_larger_than_the_models_and_nothing_else() -> None:
    ops, pvs = limit_cycle(600)
    assert 1.6 < seen_friction(with_valve(0.5), ops, pvs) < 2.5
    for right in (MODEL, with_valve(0.9), with_valve(1.5), with_gain(0.5), with_gain(2.0)):
        assert seen_friction(right, ops, pvs) == 1.0
    assert seen_friction(with_valve(0.5), ops[:100], pvs[:100]) == 1.0
    assert seen_friction(with_valve(0.5), [50.0] * 600, pvs) == 1.0


def test_a_model_of_half_the_friction_is_used_with_what_the_record_shows() -> None:
    supervisor = Supervisor(PiController(PiSettings(1.2, 9.0)))
    noise = np.random.default_rng(1).normal(0.0, 0.02, 600)
    stem, op, pv = 49.0, 50.0, 49.0
    late = [49.0] * LAG.dead_time
    errors = []
    for k in range(600):
        if k in (400, 500):  # a block of the same valve, read again
            assert supervisor.offer(with_valve(0.5))
        op = supervisor.step(pv + float(noise[k]), 50.0, op).op
        stem = MODEL.valve.step(stem, op)
        late.append(stem)
        pv = 0.9 * pv + 0.1 * late.pop(0)
        errors.append(pv - 50.0)
    assert supervisor.compensating
    assert supervisor.model is not None
    assert supervisor.model.valve.stick_band == pytest.approx(6.0, rel=0.21)
    assert np.std(errors[480:]) < 0.5 * np.std(errors[100:400])


def test_a_pv_that_comes_to_rest_is_not_frozen_and_one_that_stops_amid_noise_is() -> None:
    noise = np.random.default_rng(8).normal(0.0, 0.1, 60)
    smooth = [4.0 * 0.9**k for k in range(60)]
    rounded = [0.01 * round(100.0 * value) for value in smooth]
    moving = [0.2 * k + value for k, value in enumerate(noise.tolist())]
    cases = ((smooth, False), (rounded, False), (noise.tolist(), True), (moving, True))
    for before, is_frozen in cases:
        screen = PvScreen(30)
        for pv in before:
            assert math.isfinite(screen.check(pv, 0.1, 1.0))
        seen = [screen.check(before[-1], 0.1, 1.0) for _ in range(400)]
        assert screen.frozen is is_frozen
        assert math.isnan(seen[-1]) is is_frozen


def test_the_rounding_of_a_coarse_signal_is_found_and_noise_hides_it() -> None:
    noise = np.random.default_rng(3).normal(0.0, 1.0, 300)
    coarse, fine = PvResolution(), PvResolution()
    for value in noise:
        coarse.push(0.5 * round(float(value) / 0.5))
        fine.push(float(value))
    assert coarse.variance == pytest.approx(0.5**2 / 12.0)
    assert fine.variance < 1e-4


def test_what_pv_does_at_rest_bounds_the_noise() -> None:
    rest = RestFluctuation(settle=10, memory=40)
    noise = np.random.default_rng(5).normal(0.0, 0.3, 400)
    rest.push(5.0, moved=True)
    for k in range(10):
        rest.push(5.0 - k, moved=False)  # the answer to the move
    assert rest.variance == math.inf
    for value in noise:
        rest.push(7.0 + float(value), moved=False)
    assert rest.variance == pytest.approx(0.09, rel=0.5)


def test_a_ramp_is_expected_to_go_on_for_as_long_as_it_has_lasted() -> None:
    trend = SetpointTrend(longest=20)
    points = np.array([1, 5, 50])
    for k in range(3):
        trend.push(0.1 * k)
    assert not trend.ahead(points).any()
    for k in range(3, 11):
        trend.push(0.1 * k)
    assert trend.ahead(points) == pytest.approx([0.1, 0.5, 1.0])
    assert not trend.turns
    trend.push(1.0)  # it stays
    assert not trend.ahead(points).any()
    assert trend.turns
    trend.push(9.0)  # a step is not a ramp
    assert not trend.ahead(points).any()
    assert not trend.turns


def test_op_stays_until_a_slow_stem_has_arrived() -> None:
    """A stem that moves by 4 a scan must come to where a move of 5 or more sends it."""
    controller = HybridMpc(MODEL, HybridSettings(unseen=1.0))
    stem, goal, pv, op = 50.0, 50.0, 50.0, 50.0
    late = [50.0] * LAG.dead_time
    noise = np.random.default_rng(2).normal(0.0, 0.01, 200)
    for k in range(200):
        controller.observe(pv + float(noise[k]), op)
        op = controller.decide(50.0 if k < 30 else 56.0).op
        away = abs(goal - stem) > 1e-9
        if away or abs(op - stem) > MODEL.valve.static_friction:
            goal = op - math.copysign(MODEL.valve.dynamic_friction, op - stem)
        stem += min(max(goal - stem, -4.0), 4.0)
        late.append(stem)
        pv = 0.9 * pv + 0.1 * late.pop(0)
    assert abs(np.mean(pv) - 56.0) < 0.5
    assert controller.stem == pytest.approx(stem, abs=0.5)


def test_no_plan_puts_off_what_does_not_last() -> None:
    """A lasting error smaller than half the least move is left alone, not met by a move there and
    back shortly before the horizon ends.
    """
    planner = MovePlanner(Prediction.of(LAG, "input"))
    error = np.full(planner.points.size, -1.4)
    plan = planner.plan(error, (-9.0, 9.0), LeastMoves.alike(4.4), 1.0, 0.1)
    assert all(time <= planner.horizon // 3 for time in plan.times)


def test_a_plan_on_a_ramp_looks_ahead_to_its_next_move() -> None:
    trend = SetpointTrend(longest=20)
    assert trend.window(5, 40, 0.6) == math.inf
    for k in range(8):
        trend.push(0.1 * k)
    assert trend.window(5, 40, 0.6) == pytest.approx(5 + 0.5 * 40 + 0.5 * 6)
    with pytest.raises(CompensatorError, match="alike is a factor of at least 1"):
        SetpointTrendSettings(alike=0.5)


def test_a_ramp_is_followed_by_steps_in_its_direction_only() -> None:
    controller = HybridMpc(MODEL, HybridSettings(unseen=1.0))
    stem, pv, op = 50.0, 50.0, 50.0
    late = [stem] * LAG.dead_time
    noise = np.random.default_rng(4).normal(0.0, 0.02, 400)
    moves, errors = [], []
    for k in range(400):
        sp = 50.0 + 0.06 * max(0, k - 50)
        controller.observe(pv + float(noise[k]), op)
        op = controller.decide(sp).op
        before, stem = stem, MODEL.valve.step(stem, op)
        moves.append(stem - before)
        late.append(stem)
        pv = 0.9 * pv + 0.1 * late.pop(0)
        errors.append(pv - sp)
    assert min(moves[100:]) >= 0.0
    # Steps of J and its margin, 2.8, leave 0.8 at best.
    assert np.sqrt(np.mean(np.square(errors[100:]))) < 1.1


def test_travel_is_saved_only_while_pv_is_good_enough() -> None:
    thrift = Thrift(deviation=1.0, travel=0.1, horizon=50)
    for _ in range(300):
        thrift.push(50.2, 50.0, 0.3)
    assert thrift.price == pytest.approx(10.0)
    for k in range(25):  # half a horizon is the way to a new set-point
        thrift.push(50.2 - 0.12 * k, 47.0, 3.0)
    assert thrift.price == pytest.approx(10.0)
    for _ in range(300):
        thrift.push(47.9, 47.0, 0.3)
    assert thrift.price == 1.0
    for _ in range(300):
        thrift.push(47.2, 47.0, 0.0)
    assert thrift.price == 1.0
    for _ in range(300):  # noise alone
        thrift.push(47.9, 47.0, 0.0, 0.7)
    assert thrift.price == 1.0
    for _ in range(300):  # above the promised half, and travel is left to spend
        thrift.push(47.9, 47.0, 0.0)
    assert thrift.price == pytest.approx(0.25)
    thrift.restart()
    assert thrift.price == 1.0
    for _ in range(300):
        thrift.push(47.9, 47.0, 0.0)
    for _ in range(300):
        thrift.push(47.2, 47.0, 0.0)
    assert thrift.price == 1.0
    with pytest.raises(CompensatorError, match="least is a factor above 0 and at most 1"):
        ThriftSettings(least=1.5)
    with pytest.raises(CompensatorError, match="most is a factor of at least 1"):
        ThriftSettings(most=0.5)


@pytest.mark.parametrize("gain", [0.1, -0.1])
def test_a_loop_that_rested_before_keeps_a_right_sign_and_gives_back_a_wrong_one(
    gain: float,
) -> None:
    """The record is silent on the sign, and nothing is known of the range but the noise; a step of
    the set-point and one of the load, of half the stick band each, with a dead time of ten.
    """
    offered = LoopModel(MODEL.valve, ProcessModel((-0.9,), (gain,), 11, 50.0 * (0.1 - gain), 1.0))
    supervisor = Supervisor(PiController(PiSettings(0.2, 30.0)))
    noise = np.random.default_rng(6).normal(0.0, 0.05, 800)
    stem, pv, op = 50.0, 50.0, 50.0
    late = [50.0] * 11
    for k in range(800):
        if k == 300:
            assert supervisor.offer(offered)
        op = supervisor.step(pv + float(noise[k]), 50.0 if k < 400 else 53.0, op).op
        if supervisor.reason is not WithdrawReason.NONE:
            break
        stem = MODEL.valve.step(stem, op)
        late.append(stem + (3.0 if k >= 600 else 0.0))
        pv = 0.9 * pv + 0.1 * late.pop(0)
    if gain > 0.0:
        assert supervisor.compensating
        assert abs(pv - 53.0) < 1.5
    else:
        assert supervisor.reason is WithdrawReason.LEFT_RANGE
        assert k < 400 + 11 + 40


def test_a_level_lands_on_its_balance() -> None:
    """It rests nowhere by itself: pairs of moves there and back have to find the one position."""
    tank = ProcessModel((-1.0,), (0.03,), 3, -1.5, 1.0)
    valve = ValveModel(6.0, 2.0)
    supervisor = Supervisor(PiController(PiSettings(1.2, 40.0)))
    noise = np.random.default_rng(9).normal(0.0, 0.04, 1100)
    stem, op, pv = 49.0, 50.0, 1.0
    late = [50.0] * 2
    errors, stems = [], []
    for k in range(1100):
        if k == 500:
            assert supervisor.offer(LoopModel(valve, tank))
        op = supervisor.step(pv + float(noise[k]), 0.0, op).op
        stem = valve.step(stem, op)
        late.append(stem)
        pv += 0.03 * (late.pop(0) - 50.0)
        errors.append(pv)
        stems.append(stem)
    assert supervisor.compensating
    moves = np.count_nonzero(np.abs(np.diff(stems[600:])) > 1e-9)
    assert moves <= 8  # four corrections in 500 samples, of two moves each
    assert np.std(errors[600:]) < 0.5 * np.std(errors[100:500])
