"""The methods of the literature that the compensator is measured against."""

import math

import numpy as np
import pytest

from compensator import (
    ActionStatus,
    CompensatorError,
    Knocker,
    KnockerSettings,
    OpLimits,
    PiController,
    PiSettings,
    TwoMove,
    TwoMoveSettings,
    UnawareMpc,
)
from fieldlink.lab.study.closed_loop import EXAMPLE_1, Study, assess, run
from loop_model import LoopModel, ProcessModel, ValveModel

REST = EXAMPLE_1.process.gain * 50.0
PI = PiSettings(0.9, 10.0)


def test_the_knocker_s_pulses_have_their_width_interval_and_direction() -> None:
    knocker = Knocker(PiController(PI), KnockerSettings(3.0, width=2, interval=5))
    op, added = 50.0, []
    for _ in range(20):
        knocker.observe(40.0, op)  # PV below SP: the controller moves OP upwards
        action = knocker.decide(45.0)
        op = action.op
        added.append(float(action.detail.removeprefix("pulse ")))
    assert added[:5] == [3.0, 3.0, 0.0, 0.0, 0.0]
    assert added == added[:5] * 4


def test_the_knocker_buys_pv_with_travel() -> None:
    study = Study([(0, REST), (10, REST + 2.5)], 800, equation_noise=0.01, seed=1, stem0=48.0)
    bare = run(EXAMPLE_1.process, EXAMPLE_1.valve, PiController(PI), study)
    knocker = Knocker(PiController(PI), KnockerSettings.of(EXAMPLE_1.valve))
    knocked = run(EXAMPLE_1.process, EXAMPLE_1.valve, knocker, study)
    assert assess(knocked, 200).pv_std < 0.6 * assess(bare, 200).pv_std
    assert assess(knocked, 200).travel > 3.0 * assess(bare, 200).travel


def test_the_knocker_takes_over_and_keeps_limits() -> None:
    limits = OpLimits(40.0, 60.0, 5.0)
    knocker = Knocker(PiController(PI), KnockerSettings.of(EXAMPLE_1.valve, limits))
    study = Study([(0, REST), (10, REST + 30.0)], 100, equation_noise=0.01)
    trace = run(EXAMPLE_1.process, EXAMPLE_1.valve, knocker, study)
    assert trace.op.max() <= 60.0
    assert np.abs(np.diff(trace.op)).max() <= 5.0 + 1e-9
    for _ in range(2):  # an operator has the loop and has moved OP
        knocker.observe(50.0, 44.0)
    assert abs(knocker.decide(50.0).op - 44.0) < 1e-9


@pytest.mark.parametrize(
    ("amplitude", "width", "interval"), [(0.0, 2, 5), (1.0, 6, 5), (1.0, 0, 5)]
)
def test_a_senseless_knocker_is_refused(amplitude: float, width: int, interval: int) -> None:
    with pytest.raises(CompensatorError, match="KnockerSettings"):
        KnockerSettings(amplitude, width, interval)


def test_two_moves_put_the_stem_where_pv_settles_at_sp() -> None:
    study = Study([(0, REST), (20, REST + 2.0)], 150)
    trace = run(EXAMPLE_1.process, EXAMPLE_1.valve, TwoMove(EXAMPLE_1), study)
    target = 50.0 + 2.0 / EXAMPLE_1.process.gain
    assert trace.stem[100] == pytest.approx(target)
    assert trace.op[100] == pytest.approx(target)
    after = np.flatnonzero(np.diff(trace.stem[18:100]))
    assert after.size == 2
    assert np.prod(np.sign(np.diff(trace.stem[18:100])[after])) == -1.0


def test_two_moves_correct_what_a_wrong_gain_leaves() -> None:
    process = EXAMPLE_1.process
    wrong = ProcessModel(process.a, tuple(0.8 * b for b in process.b), 1, 0.0, 1.0)
    study = Study([(0, REST), (20, REST + 5.0)], 700, equation_noise=0.01, seed=3)
    trace = run(process, EXAMPLE_1.valve, TwoMove(LoopModel(EXAMPLE_1.valve, wrong)), study)
    assert abs(assess(trace, 400).offset) < 0.2
    assert assess(trace, 400).pv_std < 0.3


def test_two_moves_end_an_oscillation_that_another_controller_left() -> None:
    class Both:
        def __init__(self) -> None:
            self.before, self.after, self.left = UnawareMpc(process), TwoMove(EXAMPLE_1), 400

        def observe(self, pv: float, op: float) -> None:
            self.before.observe(pv, op)
            self.after.observe(pv, op)

        def decide(self, sp: float):
            self.left -= 1
            return (self.before if self.left >= 0 else self.after).decide(sp)

    process = EXAMPLE_1.process
    study = Study([(0, REST), (10, REST + 2.5)], 900, equation_noise=0.01, seed=2, stem0=48.0)
    trace = run(process, EXAMPLE_1.valve, Both(), study)
    assert assess(trace, 550).pv_std < 0.35 * assess(trace, 50, 400).pv_std


def test_two_moves_hold_through_bad_pv_and_say_when_sp_is_out_of_reach() -> None:
    limits = OpLimits(40.0, 60.0)
    study = Study(
        [(0, REST), (20, REST + 30.0)], 120, equation_noise=0.01, bad_pv=frozenset(range(90, 100))
    )
    controller = TwoMove(EXAMPLE_1, TwoMoveSettings(limits))
    trace = run(EXAMPLE_1.process, EXAMPLE_1.valve, controller, study)
    assert trace.status[60] is ActionStatus.LIMITED
    assert trace.stem[60] == pytest.approx(60.0 - EXAMPLE_1.valve.dynamic_friction)
    assert all(trace.status[k] is ActionStatus.PV_BAD for k in range(90, 100))
    assert np.unique(trace.op[89:100]).size == 1


def test_two_moves_are_refused_where_open_loop_drifts() -> None:
    level = ProcessModel((-1.0,), (0.02,), 1, -1.0, 1.0)
    with pytest.raises(CompensatorError, match="integrating"):
        TwoMove(LoopModel(ValveModel(4.0, 1.5), level))
    assert math.isnan(TwoMove(EXAMPLE_1).decide(50.0).op)
