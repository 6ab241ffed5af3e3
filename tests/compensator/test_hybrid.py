"""The compensator on sticky valves: exact parameters, wrong ones, other processes, take-over."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from compensator import (
    Action,
    ActionStatus,
    CompensatorError,
    HybridMpc,
    HybridSettings,
    OpLimits,
    UnawareMpc,
    Uncertainty,
)
from compensator.stem_tracking.belief import GAIN
from compensator.stem_tracking.friction import FrictionPrior
from compensator.stem_tracking.hypothesis_kernels import chance_of_rest
from fieldlink.lab.study.closed_loop import (
    EXAMPLE_1,
    EXAMPLE_2,
    Plant,
    Study,
    assess,
    held_stem_std,
    run,
)
from loop_model import LoopModel, ProcessModel, ValveModel
from tests.seeds import cases_in_suite, few_and_all, in_suite

NOISE = {"example1": 0.01, "example2": 10**-1.5}
EXAMPLES = {"example1": EXAMPLE_1, "example2": EXAMPLE_2}


def lag_model(example: LoopModel, gain: float) -> ProcessModel:
    """A first-order model with dead time for the third-order example, its gain off by a factor."""
    pole = math.exp(-1.0 / 8.5)
    return ProcessModel((-pole,), (gain * example.process.gain * (1.0 - pole),), 5, 0.0, 1.0)


class TakeOver:
    """The unaware MPC until a sample, the compensator, which has watched, from there on."""

    def __init__(self, process: ProcessModel, compensator: HybridMpc, at: int) -> None:
        self.first, self.second, self.left = UnawareMpc(process), compensator, at

    def observe(self, pv: float, op: float) -> None:
        self.first.observe(pv, op)
        self.second.observe(pv, op)

    def decide(self, sp: float) -> Action:
        self.left -= 1
        return (self.first if self.left >= 0 else self.second).decide(sp)


@pytest.mark.parametrize("name", in_suite(1, EXAMPLES))
@pytest.mark.parametrize("seeds", few_and_all(3, range(8)))
def test_on_the_paper_s_loops_noise_alone_is_left_of_the_oscillation(
    name: str, seeds: Sequence[int]
) -> None:
    example, sigma = EXAMPLES[name], NOISE[name]
    rest = example.process.gain * 50.0
    held = held_stem_std(example.process, sigma, 0.0)
    after, before, offsets, travel, reversals = [], [], [], [0.0, 0.0], [0, 0]
    for seed in seeds:
        study = Study(
            [(0, rest), (10, rest + 2.5)], 1200, equation_noise=sigma, seed=seed, stem0=48.0
        )
        controller = TakeOver(example.process, HybridMpc(example), 600)
        trace = run(example.process, example.valve, controller, study)
        bad, good = assess(trace, 50, 600), assess(trace, 650)
        after.append(good.pv_std)
        before.append(bad.pv_std)
        offsets.append(good.offset)
        travel = [travel[0] + bad.travel, travel[1] + good.travel]
        reversals = [reversals[0] + bad.reversals, reversals[1] + good.reversals]
    assert np.sqrt(np.mean(np.square(after))) <= 1.2 * held
    assert np.mean(after) < 0.8 * np.mean(before)
    assert travel[1] <= travel[0]
    assert reversals[1] <= reversals[0]
    assert abs(np.mean(offsets)) < 0.35 * held


FRICTIONS = [(0.8, 0.8), (1.2, 1.2), (0.8, 1.2), (1.0, 0.8), (1.0, 1.2), (1.2, 0.8)]


@pytest.mark.parametrize("name", in_suite(1, EXAMPLES))
@pytest.mark.parametrize(("static", "dynamic"), cases_in_suite(2, FRICTIONS))
@pytest.mark.parametrize("seeds", few_and_all(2, range(4)))
def test_with_wrong_frictions_it_is_no_worse_than_the_unaware(
    name: str, static: float, dynamic: float, seeds: Sequence[int]
) -> None:
    example, sigma = EXAMPLES[name], NOISE[name]
    valve = example.valve
    fs = max(static * valve.static_friction, dynamic * valve.dynamic_friction)
    wrong = ValveModel.from_friction(fs, dynamic * valve.dynamic_friction)
    rest = example.process.gain * 50.0
    before, after = [], []
    for seed in seeds:
        study = Study(
            [(0, rest), (10, rest + 2.5)], 900, equation_noise=sigma, seed=seed, stem0=48.0
        )
        controller = TakeOver(example.process, HybridMpc(LoopModel(wrong, example.process)), 400)
        trace = run(example.process, valve, controller, study)
        before.append(assess(trace, 50, 400).pv_std)
        after.append(assess(trace, 450).pv_std)
    assert np.mean(after) < np.mean(before)


@pytest.mark.parametrize("gain", in_suite(2, [0.9, 1.1, 1.0]))
def test_a_low_order_process_model_is_good_enough(gain: float) -> None:
    rest = EXAMPLE_1.process.gain * 50.0
    study = Study([(0, rest), (10, rest + 3.0)], 900, equation_noise=0.01, seed=2)
    model = LoopModel(EXAMPLE_1.valve, lag_model(EXAMPLE_1, gain))
    good = assess(run(EXAMPLE_1.process, EXAMPLE_1.valve, HybridMpc(model), study), 300)
    assert good.pv_std < 0.35
    assert abs(good.offset) < 0.15


def test_without_noise_it_reaches_the_setpoint_and_stops() -> None:
    rest = EXAMPLE_1.process.gain * 50.0
    study = Study([(0, rest), (60, rest + 1.0), (200, rest - 7.0)], 400)
    trace = run(EXAMPLE_1.process, EXAMPLE_1.valve, HybridMpc(EXAMPLE_1), study)
    # Closer than a thousandth of a slip's effect nothing pays any more.
    assert trace.pv[195] == pytest.approx(rest + 1.0, abs=0.05)
    assert trace.pv[-1] == pytest.approx(rest - 7.0, abs=0.05)
    assert np.all(np.diff(trace.stem[300:]) == 0.0)
    assert np.all(trace.op[300:] == trace.stem[300:])


def test_a_load_step_is_found_and_removed() -> None:
    rest = EXAMPLE_1.process.gain * 50.0
    study = Study([(0, rest)], 800, load=[(300, 4.0)], equation_noise=0.01, seed=5)
    trace = run(EXAMPLE_1.process, EXAMPLE_1.valve, HybridMpc(EXAMPLE_1), study)
    assert abs(assess(trace, 400).offset) < 0.2
    assert trace.stem[-1] == pytest.approx(46.0, abs=0.5)


@pytest.mark.parametrize("dead_time", [1, 8])
def test_an_integrating_level_is_kept(dead_time: int) -> None:
    process = ProcessModel((-1.0,), (0.02,), dead_time, -1.0, 1.0)
    model = LoopModel(ValveModel(4.0, 1.5), process)
    study = Study([(0, 0.0), (50, 2.0)], 1500, measurement_noise=0.01, seed=3, op0=50.0)
    trace = run(process, model.valve, HybridMpc(model), study)
    plain = run(process, model.valve, UnawareMpc(process), study)
    good, bad = assess(trace, 500), assess(plain, 500)
    assert good.rms < 0.15
    assert good.travel < 0.2 * bad.travel
    assert abs(good.offset) < 0.1


def test_op_keeps_range_and_rate() -> None:
    limits = OpLimits(40.0, 65.0, 2.0)
    rest = EXAMPLE_1.process.gain * 50.0
    study = Study([(0, rest), (10, rest + 8.0)], 500, equation_noise=0.01, seed=1)
    trace = run(
        EXAMPLE_1.process, EXAMPLE_1.valve, HybridMpc(EXAMPLE_1, HybridSettings(limits)), study
    )
    assert trace.op.min() >= 40.0
    assert trace.op.max() <= 65.0
    assert np.abs(np.diff(trace.op)).max() <= 2.0 + 1e-9
    # So slow an OP cannot choose how far the stem slips: a part of the slip jump is left.
    assert abs(assess(trace, 200).offset) < 0.2 * EXAMPLE_1.valve.slip_jump


def test_a_setpoint_out_of_reach_is_approached_and_said_so() -> None:
    limits = OpLimits(40.0, 60.0)
    rest = EXAMPLE_1.process.gain * 50.0
    controller = HybridMpc(EXAMPLE_1, HybridSettings(limits))
    study = Study([(0, rest), (50, rest + 30.0)], 300, equation_noise=0.01)
    trace = run(EXAMPLE_1.process, EXAMPLE_1.valve, controller, study)
    highest = 60.0 - EXAMPLE_1.valve.dynamic_friction
    assert trace.stem[-1] == pytest.approx(highest, abs=1e-6)
    assert trace.status[-1] is ActionStatus.LIMITED


def test_take_over_finds_the_stem_from_the_history() -> None:
    rest = EXAMPLE_1.process.gain * 50.0
    study = Study([(0, rest), (10, rest + 2.0)], 300, equation_noise=0.01, seed=4)
    trace = run(EXAMPLE_1.process, EXAMPLE_1.valve, UnawareMpc(EXAMPLE_1.process), study)
    compensator = HybridMpc(EXAMPLE_1)
    wrong = 0
    for k in range(1, 300):
        compensator.observe(float(trace.pv[k]), float(trace.op[k - 1]))
        if k > 150:
            wrong += abs(compensator.stem - trace.stem[k - 1]) > 1e-6
    # A slip is seen a few samples late at times; what counts is that the belief comes back.
    assert wrong < 0.5 * 150


def test_bad_pv_holds_op_and_control_resumes() -> None:
    rest = EXAMPLE_1.process.gain * 50.0
    bad = frozenset(range(200, 230))
    study = Study([(0, rest)], 500, equation_noise=0.01, seed=6, bad_pv=bad)
    trace = run(EXAMPLE_1.process, EXAMPLE_1.valve, HybridMpc(EXAMPLE_1), study)
    assert all(trace.status[k] is ActionStatus.PV_BAD for k in bad)
    assert np.unique(trace.op[199:230]).size == 1
    assert assess(trace, 230).pv_std < 0.3


def test_a_band_wider_than_the_range_is_refused() -> None:
    model = LoopModel(ValveModel(30.0, 5.0), EXAMPLE_1.process)
    with pytest.raises(CompensatorError, match="stick band of 30"):
        HybridMpc(model, HybridSettings(OpLimits(40.0, 60.0)))


def test_a_healthy_valve_model_is_simply_good_control() -> None:
    model = LoopModel(ValveModel(0.0, 0.0), EXAMPLE_1.process)
    rest = EXAMPLE_1.process.gain * 50.0
    study = Study([(0, rest), (50, rest + 3.0)], 500, equation_noise=0.01, seed=1)
    trace = run(EXAMPLE_1.process, None, HybridMpc(model), study)
    assert assess(trace, 150).pv_std < held_stem_std(EXAMPLE_1.process, 0.01, 0.0)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["equation_noise", "measurement_noise"])
def test_the_kind_of_noise_is_found_by_the_data(kind: str, seed: int) -> None:
    rest = EXAMPLE_1.process.gain * 50.0
    size = {"equation_noise": 0.01, "measurement_noise": 0.15}[kind]
    study = Study([(0, rest), (100, rest + 6.0)], 400, seed=seed, **{kind: size})
    controller = HybridMpc(LoopModel(ValveModel(0.0, 0.0), EXAMPLE_1.process))
    run(EXAMPLE_1.process, None, controller, study)
    noise = controller.noise
    assert (noise.equation > noise.measurement) == (kind == "equation_noise")


def test_a_missed_slip_is_found_in_pv() -> None:
    """The valve sticks half as much again as the model says: commands that it withstands at first
    must not leave the controller believing in a move that never was.
    """
    rest = EXAMPLE_1.process.gain * 50.0
    harder = ValveModel.from_friction(8.4, 4.0)
    study = Study([(0, rest), (50, rest + 4.0)], 600, equation_noise=0.01, seed=2)
    controller = HybridMpc(EXAMPLE_1, HybridSettings(slip_margin=0.0))
    trace = run(EXAMPLE_1.process, harder, controller, study)
    assert abs(controller.stem - trace.stem[-1]) < 0.1 * harder.stick_band
    assert abs(assess(trace, 300).offset) < 0.5


def test_an_unexpected_slip_is_found_in_pv() -> None:
    """A knock on the valve moves the stem while OP rests."""
    rest = EXAMPLE_1.process.gain * 50.0
    plant = Plant(EXAMPLE_1.process, EXAMPLE_1.valve, 50.0)
    noise = np.random.default_rng(5).normal(0.0, 0.01, 500)
    controller = HybridMpc(EXAMPLE_1)
    op, pv = 50.0, []
    for k in range(500):
        if k == 200:
            plant.stem += 5.0
        controller.observe(plant.pv, op)
        op = controller.decide(rest).op
        pv.append(plant.step(op, float(noise[k])))
    assert max(pv[200:300]) > rest + 0.4
    assert abs(np.mean(pv[350:]) - rest) < 0.3


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_wrong_gain_is_learnt_from_set_point_steps(factor: float) -> None:
    process = EXAMPLE_1.process
    wrong = replace(process, b=tuple(factor * b for b in process.b))
    controller = HybridMpc(LoopModel(EXAMPLE_1.valve, wrong))
    rest = process.gain * 50.0
    steps = [(0, rest), (100, rest + 12.0), (300, rest), (500, rest + 12.0)]
    study = Study(steps, 700, equation_noise=0.01, seed=2)
    run(process, EXAMPLE_1.valve, controller, study)
    believed = factor * (1.0 + controller.tracker.best.errors[GAIN])
    assert believed == pytest.approx(1.0, abs=0.08)


def test_friction_far_beyond_the_model_is_impossible() -> None:
    prior = FrictionPrior()
    law = prior.law(negligible=0.006)
    assert chance_of_rest(6.1, 5.9, law) == 0.0
    assert 0.0 < chance_of_rest(5.9, 5.8, law) < 1.0
    assert chance_of_rest(-4.1, -math.inf, law) == 1.0
    wide = FrictionPrior(uncertainty=Uncertainty(3.0, 2.0))
    assert wide.static_deviation(EXAMPLE_1.valve) == 3.0
    assert prior.static_deviation(EXAMPLE_1.valve) == pytest.approx(0.7)


def test_an_uncertain_slip_jump_comes_with_an_uncertain_gain() -> None:
    """A limit cycle at one set-point shows their product alone."""
    valve = EXAMPLE_1.valve
    assert FrictionPrior().jump_deviation(valve) == 0.0
    stated = FrictionPrior(uncertainty=Uncertainty(0.0, 0.3))
    assert stated.jump_deviation(valve) == pytest.approx(0.6 / valve.slip_jump)
    vague = FrictionPrior(uncertainty=Uncertainty(0.0, 30.0))
    assert vague.jump_deviation(valve) == vague.jump_spread_most
    assert stated.jump_deviation(ValveModel(4.0, 0.0)) == 0.0
    vague_errors = vague.error_covariance(valve, 0.1)
    assert np.linalg.eigvalsh(vague_errors).min() > 0.0
    assert vague_errors[0, 1] < 0.0 == FrictionPrior().error_covariance(valve, 0.1)[0, 1]
    # Their product is known: what is uncertain of it is what the gain has by itself.
    half = np.array([1.0 / (0.5 * valve.slip_jump), 1.0])
    assert half @ stated.error_covariance(valve, 0.0) @ half == pytest.approx(
        (half[0] * stated.dynamic_deviation(valve)) ** 2 - stated.jump_deviation(valve) ** 2
    )
