"""Plans under a rate limit of OP, against every OP sequence of a lattice and in closed loop."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest

from compensator import HybridMpc, HybridSettings, MpcSettings, OpLimits, Prediction, UnawareMpc
from compensator.hybrid.moves import LeastMoves, MovePlanner, Ramp
from fieldlink.lab.study.closed_loop import EXAMPLE_1, Study, assess, run
from loop_model import LoopModel, ProcessModel, ValveModel
from tests.seeds import few_and_all

LAG = ProcessModel((-0.7,), (0.3,), 1, 0.0, 1.0)
REST = EXAMPLE_1.process.gain * 50.0


@pytest.mark.parametrize("sp", [-3.0, -1.0, 0.5, 1.5, 4.0])
def test_no_sequence_of_op_does_better_with_two_moves(sp: float) -> None:
    """All OP sequences of a lattice over a horizon of six samples, through He's valve itself."""
    valve = ValveModel.from_friction(2.0, 1.0)
    planner = MovePlanner(Prediction.of(LAG, "input"), HybridSettings(horizon=6))
    move_cost, travel_cost = 0.3, 0.05
    error = np.full(planner.points.size, -sp)
    plan = planner.plan(
        error, (-9.0, 9.0), LeastMoves.alike(valve.slip_jump), move_cost, travel_cost
    )
    lattice = np.arange(-7.5, 7.6, 1.5)
    count = min(5, int(planner.times[-1]) + 1)
    sequences = np.array(list(itertools.product(lattice, repeat=count)))
    stem = np.zeros(len(sequences))
    pv = np.zeros(len(sequences))
    cost = np.zeros(len(sequences))
    moves = np.zeros(len(sequences), dtype=int)
    for k in range(6):
        op = sequences[:, min(k, count - 1)]
        e = op - stem
        moved = np.where(
            np.abs(e) > valve.static_friction, op - np.sign(e) * valve.dynamic_friction, stem
        )
        change = moved - stem
        moves += change != 0.0
        cost += move_cost * (change != 0.0) + travel_cost * np.abs(change)
        stem = moved
        pv = 0.7 * pv + 0.3 * stem
        cost += (pv - sp) ** 2
    assert plan.cost <= cost[moves <= 2].min() + 1e-9


@pytest.mark.parametrize("sp", [-4.0, 2.0, 6.0])
def test_no_plan_that_keeps_the_ramp_is_better(sp: float) -> None:
    planner = MovePlanner(Prediction.of(LAG, "input"), HybridSettings(horizon=14))
    ramp = Ramp(up=2, down=3, same=2, opposite=4, largest=2.5)
    error = np.full(planner.points.size, -sp)
    plan = planner.plan(error, (-8.0, 8.0), LeastMoves.alike(1.0), 0.1, 0.02, ramp)
    response = np.concatenate([[0.0], planner.prediction.step_response(14)])
    sizes = np.concatenate([np.arange(-2.5, -0.9, 0.25), np.arange(1.0, 2.6, 0.25)])

    def price(moves: dict[int, float]) -> float:
        total = error.copy()
        for time, change in moves.items():
            after = planner.points - time
            total += change * np.where(after > 0, response[np.maximum(after, 0)], 0.0)
        sized = sum(map(abs, moves.values()))
        return float(planner.weights @ total**2) + 0.1 * len(moves) + 0.02 * sized

    best = price({})
    for i, j in itertools.combinations(planner.times.tolist(), 2):
        for one, two in itertools.product(sizes, sizes):
            if i < (2 if one > 0.0 else 3):
                continue
            best = min(best, price({i: one}))
            if j - i >= (2 if one * two > 0.0 else 4):
                best = min(best, price({i: one, j: two}))
    assert plan.cost <= best + 1e-9
    changes = np.diff(plan.changes, prepend=0.0)
    assert all(1.0 - 1e-9 <= abs(change) <= 2.5 + 1e-9 for change in changes)
    assert not plan.times or plan.times[0] >= (2 if changes[0] > 0.0 else 3)


@pytest.mark.parametrize(
    ("rate", "share"),
    [
        (0.6, 0.7),
        *(
            pytest.param(*one, marks=pytest.mark.thorough)
            for one in ((1.0, 0.8), (2.0, 0.3), (3.0, 0.65))
        ),
    ],
)
@pytest.mark.parametrize("seeds", few_and_all(2, range(4)))
def test_a_slow_op_still_takes_the_oscillation_away(
    rate: float, share: float, seeds: Sequence[int]
) -> None:
    limits = OpLimits(rate=rate)
    good, bad = [], []
    for seed in seeds:
        study = Study(
            [(0, REST), (10, REST + 4.0)], 700, equation_noise=0.01, seed=seed, stem0=48.0
        )
        hybrid = HybridMpc(EXAMPLE_1, HybridSettings(limits))
        compensated = run(EXAMPLE_1.process, EXAMPLE_1.valve, hybrid, study)
        unaware = UnawareMpc(EXAMPLE_1.process, MpcSettings(limits=limits))
        plain = run(EXAMPLE_1.process, EXAMPLE_1.valve, unaware, study)
        assert np.abs(np.diff(compensated.op)).max() <= rate + 1e-9
        good.append(assess(compensated, 250).rms)
        bad.append(assess(plain, 250).rms)
    assert np.mean(good) < share * np.mean(bad)


def test_the_plan_counts_the_scans_that_op_needs() -> None:
    """fS 2, fD 1, rate 0.5: from mid-band the edge is four scans away, the slip is the fifth."""
    model = LoopModel(ValveModel.from_friction(2.0, 1.0), LAG)
    slow = HybridMpc(model, HybridSettings(OpLimits(rate=0.5), slip_margin=0.0, unseen=1.0))
    quick = HybridMpc(model, HybridSettings(slip_margin=0.0, unseen=1.0))
    for controller in (slow, quick):
        controller.observe(50.0, 50.0)
    assert quick.plan(55.0).times[0] == 0
    assert slow.plan(55.0).times[0] == math.ceil(2.0 / 0.5) - 1
    assert slow.decide(55.0).op == 50.5
