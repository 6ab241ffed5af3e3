"""What a supervisor does between an offer and the take-over, and after a load beyond its range."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.tuned.tuning_loops import TunedLoop
from compensator import (
    HybridMpc,
    HybridSettings,
    OpLimits,
    PiController,
    PiSettings,
    Supervisor,
    SupervisorSettings,
    SupervisorState,
    UnawareMpc,
    WithdrawReason,
)
from compensator.supervising.figures import Sample
from compensator.supervising.load_cause import explained_by_load
from compensator.supervising.reliving import Reliving
from fieldlink.lab.study.closed_loop import EXAMPLE_1, Plant
from loop_model import LoopModel, ProcessModel, ValveModel
from tests.compensator.supervised_loop import REST, Loop, wrong_sign
from tests.seeds import in_suite


class Counting:
    """Notes what it observes."""

    def __init__(self) -> None:
        self.seen: list[float] = []

    def observe(self, pv: float, op: float) -> None:  # noqa: ARG002
        self.seen.append(pv)


def test_a_compensator_that_relives_in_slices_ends_where_one_does_that_saw_all_at_once() -> None:
    loop = Loop()
    loop.run(360)
    samples = [Sample(pv, REST + 2.5, op, True) for pv, op in zip(loop.pv, loop.op, strict=False)]
    at_once, in_slices = HybridMpc(EXAMPLE_1), HybridMpc(EXAMPLE_1)
    for sample in samples:
        at_once.observe(sample.pv, sample.op)
    reliving = Reliving(10)
    reliving.begin(samples[:300])
    for sample in samples[300:]:
        reliving.observe(in_slices, sample)
    assert reliving.done
    assert in_slices.stem == at_once.stem
    assert in_slices.held_variance == at_once.held_variance
    assert in_slices.decide(REST + 2.5) == at_once.decide(REST + 2.5)


def test_no_scan_relives_more_than_its_share() -> None:
    reliving, counting = Reliving(10), Counting()
    reliving.begin([Sample(float(k), 0.0, 0.0, True) for k in range(300)])
    scans = 0
    while not reliving.done:
        before = len(counting.seen)
        reliving.observe(counting, Sample(300.0 + scans, 0.0, 0.0, True))  # type: ignore[arg-type]
        assert len(counting.seen) - before <= 10
        scans += 1
    assert counting.seen == [float(k) for k in range(300 + scans)]
    assert scans == 34


def test_an_offer_in_every_scan_keeps_no_model_from_taking_over() -> None:
    loop = Loop()
    loop.run(400)
    process = EXAMPLE_1.process
    faster = replace(process, b=tuple(1.05 * b for b in process.b))
    for k in range(200):
        assert loop.supervisor.offer(LoopModel(EXAMPLE_1.valve, (process, faster)[k % 2]))
        loop.run(1)
    assert SupervisorState.COMPENSATING in loop.states[400:500]
    assert loop.supervisor.compensating


def test_an_offer_made_meanwhile_is_begun_afterwards() -> None:
    loop = Loop()
    loop.run(400)
    process = replace(EXAMPLE_1.process, b=tuple(1.05 * b for b in EXAMPLE_1.process.b))
    later = LoopModel(EXAMPLE_1.valve, process)
    assert loop.supervisor.offer(EXAMPLE_1)
    assert loop.supervisor.offer(later)
    loop.run(200)  # the one in use has not been judged yet
    assert loop.supervisor.model == EXAMPLE_1
    loop.run(500)
    assert loop.supervisor.model == later
    assert loop.supervisor.compensating


@pytest.mark.parametrize("seed", in_suite(1, range(3)))
def test_models_that_come_before_one_can_be_judged_do_not_blind_the_watch(seed: int) -> None:
    """The stem goes after OP while OP rests, so that no model is right; a new one comes every 60
    scans, and none of them may keep the loop while PV is worse and the stem travels more.
    """
    process = ProcessModel((-(15.0 / 16.0),), (1.2 / 16.0,), 4, 0.0, 1.0)
    valve, friction, spring = ValveModel(6.0, 2.0), 4.0, [49.0]

    def positioner(stem: float, op: float) -> float:
        spring[0] += 0.1 * (op - stem)
        gap = spring[0] + 0.4 * (op - stem) - stem
        return stem + math.copysign(abs(gap) - 2.0, gap) if abs(gap) > friction else stem

    plant = Plant(process, positioner, 50.0, 49.0)
    supervisor = Supervisor(PiController(PiSettings(1.2, 16.0, 1.0)))
    rng = np.random.default_rng(seed)
    noise, op, held = rng.normal(0.0, 0.1, 2000), 50.0, np.zeros(2000, dtype=bool)
    for k in range(2000):
        if k >= 500 and k % 60 == 20:
            factor = float(rng.uniform(0.7, 1.4))
            other = replace(process, b=tuple(factor * b for b in process.b))
            supervisor.offer(LoopModel(valve, other))
        op = supervisor.step(plant.pv + float(noise[k]), 62.0, op).op
        plant.step(op)
        held[k] = supervisor.compensating
    assert held[500:].any()
    assert supervisor.memory.given_up
    assert not held[-300:].any()


@pytest.mark.parametrize("low", [60.0, 0.0])
def test_op_outside_the_compensators_limits_waits_with_a_reason(low: float) -> None:
    plant = Plant(EXAMPLE_1.process, EXAMPLE_1.valve, 50.0, 48.0)
    settings = SupervisorSettings(HybridSettings(OpLimits(low, 90.0)))
    supervisor, op = Supervisor(UnawareMpc(EXAMPLE_1.process), settings), 50.0
    noise = np.random.default_rng(2).normal(0.0, 0.01, 700)
    for k in range(700):
        if k == 400:
            assert supervisor.offer(EXAMPLE_1)
        op = supervisor.step(plant.pv, REST + 2.5, op).op
        plant.step(op, float(noise[k]))
    inside = low == 0.0
    assert supervisor.compensating is inside
    assert not supervisor.memory.given_up
    assert supervisor.reason is (WithdrawReason.NONE if inside else WithdrawReason.OP_OUTSIDE)


def test_an_op_that_another_moves_out_of_the_limits_is_not_followed() -> None:
    """What may not be written is not approached from outside either, and no model is blamed."""
    plant = Plant(EXAMPLE_1.process, EXAMPLE_1.valve, 50.0, 48.0)
    settings = SupervisorSettings(HybridSettings(OpLimits(20.0, 80.0, 3.0)))
    supervisor, op = Supervisor(UnawareMpc(EXAMPLE_1.process), settings), 50.0
    noise = np.random.default_rng(3).normal(0.0, 0.01, 900)
    for k in range(900):
        if k == 400:
            assert supervisor.offer(EXAMPLE_1)
        if k == 600:
            assert supervisor.compensating
        if 600 <= k < 610:
            op = 95.0
        op = supervisor.step(plant.pv, REST + 2.5, op).op
        if 600 <= k < 610:
            assert not supervisor.compensating
            assert supervisor.reason is WithdrawReason.OP_OUTSIDE
        plant.step(op, float(noise[k]))
    assert supervisor.compensating
    assert not supervisor.memory.given_up


@pytest.mark.parametrize("seed", in_suite(1, range(4)))
@pytest.mark.parametrize("name", in_suite(2, ["lag", "tank", "two lags", "underdamped"]))
def test_a_load_of_three_stick_bands_costs_no_right_model(name: str, seed: int) -> None:
    loop = TunedLoop.of(name, "steady", "pi")
    supervisor, unit = Supervisor(loop.make_controller()), loop.band * loop.scale
    plant, rng = loop.make_plant(seed), np.random.default_rng(seed)
    noise, op = loop.noise * loop.jump * loop.scale, 50.0
    for k in range(1300):
        if k == 500:
            assert supervisor.offer(loop.true_model())
        pv = plant.pv + noise * float(rng.normal())
        op = supervisor.step(pv, 0.4 * unit if k > 20 else 0.0, op).op
        plant.step(op, 3.0 * loop.band if k >= 700 + 17 * seed else 0.0)
    assert not supervisor.memory.given_up
    assert supervisor.compensating


def excursion(seed: int) -> list[Sample]:
    """Return a rest of a hundred scans and forty after a load, which two moves answer to."""
    plant = Plant(EXAMPLE_1.process, EXAMPLE_1.valve, 50.0, 50.0)
    noise, samples, op = np.random.default_rng(seed), [], 50.0
    for k in range(140):
        samples.append(Sample(plant.pv, REST, op, False))
        op = 50.0 if k < 106 else 30.0 if k < 114 else 20.0
        plant.step(op, float(noise.normal(0.0, 0.01)), 25.0 if k >= 100 else 0.0)
    return samples


@pytest.mark.parametrize("seed", range(20))
def test_a_step_of_the_load_is_told_from_a_gain_of_the_wrong_sign(seed: int) -> None:
    samples = excursion(seed)
    for model, right in ((EXAMPLE_1, True), (wrong_sign(), False)):
        prediction = HybridMpc(model).prediction
        found = explained_by_load(samples, 40, prediction, model.valve, 0.05)
        assert found is right
