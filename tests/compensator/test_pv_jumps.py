"""A PV that jumps farther than a process can make it is a fault; a right model outlives it."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest

from benchmarks.tuned.linear_plants import PROCESSES
from benchmarks.tuned.tuning_loops import TunedLoop
from compensator import HybridMpc, Supervisor, SupervisorState, WithdrawReason
from compensator.prediction import Prediction
from compensator.supervising.figures import LoopRecord, Sample
from compensator.supervising.jumps import JumpScreen, JumpSettings
from fieldlink.lab.study.closed_loop import EXAMPLE_1
from tests.compensator.supervised_loop import REST, Loop
from tests.seeds import in_suite

PREDICTION = Prediction.of(EXAMPLE_1.process, "input")


def screened(values: list[float], op_span: float = 5.0) -> list[float]:
    """Return what is left of PVs after forty scans of noise around zero."""
    screen = JumpScreen()
    check = partial(
        screen.check,
        prediction=PREDICTION,
        valve=EXAMPLE_1.valve,
        op_span=lambda: op_span,
    )
    for value in np.random.default_rng(1).normal(0.0, 0.01, 40):
        check(float(value))
    return [check(value) for value in values]


def test_the_fastest_change_is_that_of_the_step_response() -> None:
    for process in (*(p.model() for p in PROCESSES.values()), EXAMPLE_1.process):
        prediction = Prediction.of(process, "input")
        steps = np.diff(prediction.step_response(300), prepend=0.0)
        assert prediction.fastest == pytest.approx(float(np.abs(steps).max()))


def test_a_jump_beyond_what_the_process_can_make_is_bad_for_three_scans_and_then_believed() -> None:
    # The process makes 0.11 per OP in a scan; 5 OP of way, a stick band of 12 and three of load.
    assert np.isnan(screened([9.0, 9.0, 9.0])).all()
    assert screened([9.0, 9.0, 9.0, 9.0])[3] == 9.0
    assert screened([9.0, 0.0])[1] == 0.0


def test_what_a_load_or_op_can_do_is_no_jump() -> None:
    possible = PREDICTION.fastest * 3.0 * EXAMPLE_1.valve.stick_band
    assert screened([possible]) == [possible]
    assert screened([9.0], op_span=100.0) == [9.0]


def test_after_a_gap_pv_may_have_gone_farther() -> None:
    far = 1.5 * PREDICTION.fastest * (5.0 + 4.0 * EXAMPLE_1.valve.stick_band)
    assert math.isnan(screened([far])[0])
    assert screened([math.nan, far])[1] == far


@pytest.mark.parametrize("name", in_suite(2, sorted(PROCESSES)))
def test_no_right_model_is_given_up_for_a_wild_pv(name: str) -> None:
    loop = TunedLoop.of(name, "steady", "pi")
    for seed, size, scans in ((1, 1.0, 1), (2, -10.0, 3), (3, 1e30, 3)):
        supervisor, unit = Supervisor(loop.make_controller()), loop.band * loop.scale
        plant, rng = loop.make_plant(seed), np.random.default_rng(seed)
        noise = loop.noise * loop.jump * loop.scale
        op, at = 50.0, range(560, 560 + scans)
        for k in range(760):
            if k == 400:
                assert supervisor.offer(loop.true_model())
            pv = plant.pv + noise * float(rng.normal())
            held = supervisor.compensating
            seen = pv + size * unit if k in at else pv
            action = supervisor.step(seen, 0.4 * unit if k > 20 else 0.0, op)
            if k in at:
                assert held
                assert action.op == op
            op = action.op
            plant.step(op)
        assert supervisor.compensating
        assert not supervisor.memory.given_up


@pytest.mark.parametrize("seed", in_suite(1, range(20)))
def test_spikes_in_one_scan_of_a_hundred_cost_no_model(seed: int) -> None:
    loop, spikes = Loop(seed), np.random.default_rng(seed).random(1200) < 0.01
    loop.run(400)
    assert loop.supervisor.offer(EXAMPLE_1)
    true, plant = loop.plant.pv, loop.plant
    for k in range(800):
        true = plant.pv
        seen = true + (30.0 if spikes[k] else 0.0)
        op = loop.supervisor.step(seen, REST + 2.5, loop.op[-1]).op
        plant.step(op, float(loop.noise[400 + k]))
        loop.pv.append(true)
        loop.op.append(op)
    assert not loop.supervisor.memory.given_up
    assert loop.supervisor.compensating
    assert loop.std(700) < 0.5 * loop.std(50, 400)


@pytest.mark.parametrize("value", in_suite(1, [-1.7e308, 3e38, 1e10, -1e30, 1e200]))
@pytest.mark.parametrize("scans", [3, 20])
def test_an_absurd_pv_gives_the_loop_back_for_a_while_at_most(value: float, scans: int) -> None:
    loop = Loop()
    loop.run(400)
    assert loop.supervisor.offer(EXAMPLE_1)
    loop.run(200)
    assert loop.supervisor.compensating
    for _ in range(scans):
        action = loop.supervisor.step(value, REST + 2.5, loop.op[-1])
        assert math.isfinite(action.op)
    if scans > JumpSettings().scans:
        assert loop.supervisor.state is SupervisorState.WAITING
        assert loop.supervisor.reason is WithdrawReason.PV_BAD
    loop.run(300)
    # After twenty scans of it the loop's own controller may need longer than that.
    assert loop.supervisor.compensating or scans > JumpSettings().scans
    assert loop.supervisor.state is not SupervisorState.BASE
    assert not loop.supervisor.memory.given_up


def test_an_absurd_first_pv_is_forgotten_by_a_controller_alone() -> None:
    controller, noise = HybridMpc(EXAMPLE_1), np.random.default_rng(3).normal(0.0, 0.01, 200)
    for k in range(200):
        controller.observe(1e30 if k == 0 else 50.0 + float(noise[k]), 50.0)
    assert float(controller.tracker.best.state[0]) == pytest.approx(50.0, abs=0.1)


def test_a_jump_from_before_an_offer_is_in_no_figures() -> None:
    clean, wild = Loop(), Loop()
    for loop in (clean, wild):
        loop.run(200)
        if loop is wild:
            sample = loop.supervisor.step(1e4, REST + 2.5, loop.op[-1])
            loop.plant.step(sample.op, 0.0)
            loop.op.append(loop.op[-1])
        loop.run(200)
        assert loop.supervisor.offer(EXAMPLE_1)
        loop.run(200)
        assert loop.supervisor.compensating
    figures = [loop.supervisor.memory.figures for loop in (clean, wild)]
    assert figures[0] is not None
    assert figures[1] is not None
    assert figures[1].largest < 100.0


def stepped(way: int, rate: float, scans: int) -> LoopRecord:
    """Return a cycle of +-1, then a set-point 30 higher that PV takes ``way`` scans to reach."""
    record = LoopRecord(1200)
    for k in range(300):
        record.push(Sample(math.sin(2.0 * math.pi * k / 60.0), 0.0, 50.0, True))
    for k in range(scans):
        error = -30.0 * max(0.0, 1.0 - k / way) + (k > way) * math.sin(rate * (k - way))
        record.push(Sample(30.0 + error, 30.0, 50.0, True))
    return record


def test_the_way_to_a_set_point_is_left_out_until_pv_arrives() -> None:
    """The model's horizon says forty scans; the loop needs a hundred and fifty."""
    record = stepped(150, 2.0 * math.pi / 60.0, 400)
    found = record.figures(80, 160, EXAMPLE_1.valve)
    assert found is not None
    assert found.largest < 1.1


def test_a_loop_that_never_arrives_has_figures_all_the_same() -> None:
    record = LoopRecord(1200)
    for sp in (0.0, 30.0):
        for k in range(300):
            record.push(Sample(sp - 2.0 + 0.5 * math.sin(k), sp, 50.0, True))
    found = record.figures(80, 160, EXAMPLE_1.valve)
    assert found is not None
    assert found.largest == pytest.approx(2.5, abs=0.01)
    only = LoopRecord(1200)
    only.push(Sample(0.0, 5.0, 50.0, False))
    for k in range(200):
        only.push(Sample(2.0 + 0.5 * math.sin(k), 5.0, 50.0, True))
    assert only.figures(80, 40, EXAMPLE_1.valve) is not None
