"""The stiction-embedding MPC: what the paper asks of it, its bounds, and the hybrid beside it."""

import math
import sys

import numpy as np
import pytest

from compensator import (
    ActionStatus,
    CompensatorError,
    EmbeddingMpc,
    EmbeddingSettings,
    HybridMpc,
    HybridSettings,
    OpLimits,
    UnawareMpc,
)
from fieldlink.lab.study.closed_loop import EXAMPLE_1, EXAMPLE_2, Plant, Study, assess, run
from loop_model import LoopModel, ProcessModel, ValveModel

pytest.importorskip("casadi")

REST = EXAMPLE_1.process.gain * 50.0


@pytest.mark.slow
def test_it_takes_the_oscillation_away() -> None:
    study = Study([(0, REST), (10, REST + 2.5)], 260, equation_noise=0.01, seed=1, stem0=48.0)
    bad = run(EXAMPLE_1.process, EXAMPLE_1.valve, UnawareMpc(EXAMPLE_1.process), study)
    good = run(EXAMPLE_1.process, EXAMPLE_1.valve, EmbeddingMpc(EXAMPLE_1), study)
    assert assess(good, 80).rms < 0.4 * assess(bad, 80).rms
    # A scan without a converged solve is held, never given a solution that is none.
    failed = good.status.count(ActionStatus.SOLVER_FAILED)
    assert failed <= 0.02 * len(good.status)
    assert good.status.count(ActionStatus.OPTIMAL) + failed == len(good.status)


@pytest.mark.slow
def test_op_keeps_range_and_rate() -> None:
    limits = OpLimits(40.0, 65.0, 2.0)
    study = Study([(0, REST), (10, REST + 6.0)], 120, equation_noise=0.01, seed=1)
    controller = EmbeddingMpc(EXAMPLE_1, EmbeddingSettings(limits=limits))
    trace = run(EXAMPLE_1.process, EXAMPLE_1.valve, controller, study)
    assert trace.op.min() >= 40.0
    assert trace.op.max() <= 65.0
    assert np.abs(np.diff(trace.op)).max() <= 2.0 + 1e-9
    assert abs(trace.pv[-1] - trace.sp[-1]) < EXAMPLE_1.valve.slip_jump


def test_a_solve_that_stopped_at_its_bound_is_never_applied() -> None:
    controller = EmbeddingMpc(EXAMPLE_1, EmbeddingSettings(max_iterations=1))
    plant = Plant(EXAMPLE_1.process, EXAMPLE_1.valve, 50.0)
    op = 50.0
    for k in range(15):
        controller.observe(plant.pv, op)
        action = controller.decide(REST + (5.0 if k > 3 else 0.0))
        assert action.status is ActionStatus.SOLVER_FAILED
        assert action.op == op == 50.0
        plant.step(action.op)
    assert controller.iterations > 0


def test_its_three_warm_starts_are_those_of_the_text() -> None:
    controller = EmbeddingMpc(EXAMPLE_1, EmbeddingSettings(estimator=HybridSettings(unseen=1.0)))
    controller.observe(REST, 50.0)
    first = controller.warm_starts(REST + 15.0)
    assert list(first) == ["the compensator's plan", "hold"]
    action = controller.decide(REST + 15.0)
    assert action.op > 50.0 + EXAMPLE_1.valve.static_friction
    controller.observe(REST, action.op)
    assert "the shifted solution" in controller.warm_starts(REST + 15.0)
    controller.observe(REST, 49.0)  # somebody else moved OP: the old solution is void
    assert "the shifted solution" not in controller.warm_starts(REST + 15.0)


def test_a_bad_pv_holds_op() -> None:
    controller = EmbeddingMpc(EXAMPLE_2)
    assert controller.decide(50.0).status is ActionStatus.NOT_READY
    controller.observe(47.4, 50.0)
    controller.observe(math.nan, 50.0)
    action = controller.decide(55.0)
    assert (action.op, action.status) == (50.0, ActionStatus.PV_BAD)


def test_without_casadi_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(CompensatorError, match=r'pip install "fieldlink\[nlp\]"'):
        EmbeddingMpc(EXAMPLE_1)


@pytest.mark.parametrize("distance", [-4.0, -1.0, 0.4, 1.5, 3.0, 8.0])
def test_the_plan_of_moves_is_not_dearer_than_its_solution(distance: float) -> None:
    """One problem: PV's squared error over the planner's points, and the price of each move."""
    model = LoopModel(ValveModel(4.0, 1.5), ProcessModel((-0.85,), (0.15,), 2, 0.0, 1.0))
    embedding = EmbeddingMpc(model, EmbeddingSettings(horizon=30, op_weight=1e-4))
    hybrid = HybridMpc(model)
    for _ in range(3):
        hybrid.observe(50.0, 50.0)
        embedding.observe(50.0, 50.0)
    sp = 50.0 + distance
    plan = hybrid.plan(sp)
    embedding.decide(sp)
    op = embedding.solution
    assert op is not None
    planner, tracker = hybrid.planner, hybrid.tracker
    stem = model.valve.simulate(op, hybrid.stem)
    changes = np.diff(stem, prepend=hybrid.stem)
    error = planner.held_pv(tracker.free(tracker.best), tracker.drive(tracker.best)) - sp
    response = np.concatenate([[0.0], hybrid.prediction.step_response(planner.horizon)])
    for time in np.flatnonzero(changes):
        after = planner.points - time
        error = error + changes[time] * np.where(after > 0, response[np.maximum(after, 0)], 0.0)
    price = float(planner.weights @ error**2)
    move_cost, travel_cost = hybrid.prices()
    price += move_cost * np.count_nonzero(changes) + travel_cost * float(np.abs(changes).sum())
    assert plan.cost <= price * (1.0 + 1e-9)
