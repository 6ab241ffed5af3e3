"""The move plan against brute force and against SciPy."""

import itertools

import numpy as np
import pytest
from scipy import optimize

from compensator import HybridSettings, Prediction
from compensator.hybrid.move_kernels import best_on_polygon
from compensator.hybrid.moves import LeastMoves, MovePlan, MovePlanner
from fieldlink.lab.study.closed_loop import EXAMPLE_1
from loop_model import ProcessModel

LAG = ProcessModel((-0.8,), (0.4,), 2, 0.0, 1.0)
LEVEL = ProcessModel((-1.0,), (0.1,), 1, 0.0, 1.0)


def cost_by_simulation(
    planner: MovePlanner,
    process: ProcessModel,
    moves: dict[int, float],
    start: float,
    sp: float,
    move_cost: float,
    travel_cost: float,
) -> float:
    """Simulate the ARX equation from rest with the moves made, and price the result."""
    stem = np.full(planner.horizon + 1, start)
    for time, change in moves.items():
        stem[time:] += change
    rest = 0.0 if process.is_integrating else process.gain * start
    padded = np.concatenate([np.full(20, start), stem])
    pv = process.simulate(padded, pv0=np.full(len(process.a), rest))[20:]
    error = pv[planner.points] - sp
    made = [abs(change) for change in moves.values() if change]
    return float(
        np.sum(planner.weights * error**2) + move_cost * len(made) + travel_cost * sum(made)
    )


def solve(
    planner: MovePlanner, process: ProcessModel, start: float, sp: float, **options: float
) -> MovePlan:
    rest = 0.0 if process.is_integrating else process.gain * start
    state, drive = planner.prediction.equilibrium(rest, 0.0)
    free = planner.prediction.A @ state
    error = planner.held_pv(free, start if not process.is_integrating else drive) - sp
    return planner.plan(
        error,
        (options["low"] - start, options["high"] - start),
        LeastMoves.alike(options["smallest"]),
        options["move_cost"],
        options["travel_cost"],
    )


@pytest.mark.parametrize("process", [LAG, LEVEL, EXAMPLE_1.process])
@pytest.mark.parametrize("smallest", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("sp", [0.0, 0.3, -1.2, 4.0])
def test_no_plan_of_a_fine_lattice_is_better(
    process: ProcessModel, smallest: float, sp: float
) -> None:
    planner = MovePlanner(Prediction.of(process, "input"), HybridSettings(horizon=14))
    prices = {"move_cost": 0.05, "travel_cost": 0.02}
    plan = solve(planner, process, 0.0, sp, low=-3.0, high=3.0, smallest=smallest, **prices)
    sizes = np.arange(-6.0, 6.01, 0.25)
    best = cost_by_simulation(planner, process, {}, 0.0, sp, **prices)
    assert plan.hold_cost == pytest.approx(best)
    # Superposition: the lattice is priced with the step responses of the simulated model.
    effects = {
        int(t): process.simulate(
            np.concatenate([np.zeros(20 + int(t)), np.ones(planner.horizon + 1 - int(t))]),
            pv0=np.zeros(len(process.a)),
        )[20:][planner.points]
        for t in planner.times
    }
    for first, second in itertools.combinations(effects, 2):
        one, two = np.meshgrid(sizes, sizes, indexing="ij")
        allowed = (
            ((np.abs(one) >= smallest) | (one == 0.0))
            & ((np.abs(two) >= smallest) | (two == 0.0))
            & (np.abs(one) <= 3.0)
            & (np.abs(one + two) <= 3.0)
        )
        error = -sp + one[..., None] * effects[first] + two[..., None] * effects[second]
        cost = (planner.weights * error**2).sum(axis=-1)
        cost += 0.05 * ((one != 0.0).astype(float) + (two != 0.0))
        cost += 0.02 * (np.abs(one) + np.abs(two))
        best = min(best, float(cost[allowed].min()))
    assert plan.cost <= best + 1e-9
    changes = np.diff(plan.changes, prepend=0.0)
    made = dict(zip(plan.times, changes, strict=True))
    again = cost_by_simulation(planner, process, made, 0.0, sp, **prices)
    assert plan.cost == pytest.approx(again, abs=1e-9)
    assert all(abs(change) >= smallest - 1e-12 for change in changes)
    assert all(-3.0 - 1e-12 <= change <= 3.0 + 1e-12 for change in plan.changes)


@pytest.mark.parametrize("seed", range(30))
def test_the_polygon_s_optimum_is_scipy_s(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(2, 2))
    H = root @ root.T + 0.05 * np.eye(2)
    g = rng.normal(size=2) * 3.0
    low, high = np.sort(rng.uniform(-2.0, 2.0, (2, 2)), axis=0)
    sign, smallest = float(rng.choice([-1.0, 1.0])), float(rng.uniform(0.0, 1.5))
    largest = smallest + float(rng.uniform(0.0, 2.0)) if seed % 2 else np.inf
    value, p, q = best_on_polygon(
        *(H[0, 0], H[0, 1], H[1, 1], g[0], g[1]),
        *(low[0], high[0], low[1], high[1], sign, smallest, largest),
    )
    feasible = optimize.linprog(
        [0.0, 0.0],
        [[sign, -sign], [-sign, sign]],
        [-smallest, min(largest, 1e6)],
        bounds=list(zip(low, high, strict=True)),
    )
    if not feasible.success:
        assert value == np.inf
        return
    best = optimize.minimize(
        lambda z: float(z @ H @ z + 2.0 * g @ z),
        feasible.x,
        jac=lambda z: 2.0 * (H @ z + g),
        bounds=list(zip(low, high, strict=True)),
        constraints=[
            {"type": "ineq", "fun": lambda z: sign * (z[1] - z[0]) - smallest},
            {"type": "ineq", "fun": lambda z: min(largest, 1e6) - sign * (z[1] - z[0])},
        ],
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 300},
    )
    assert value == pytest.approx(best.fun, abs=1e-6)
    assert low[0] - 1e-9 <= p <= high[0] + 1e-9
    assert smallest - 1e-9 <= sign * (q - p) <= largest + 1e-9


def test_a_target_nearer_than_the_slip_jump_is_reached_by_moving_away_and_back() -> None:
    planner = MovePlanner(Prediction.of(LAG, "input"))
    plan = solve(
        planner, LAG, 0.0, 1.0, low=-50.0, high=50.0, smallest=3.0, move_cost=0.1, travel_cost=0.0
    )
    assert plan.times[0] == 0
    assert len(plan.changes) == 2
    assert plan.changes[1] == pytest.approx(1.0 / LAG.gain, abs=0.05)


def test_an_error_that_does_not_pay_is_left() -> None:
    planner = MovePlanner(Prediction.of(LAG, "input"))
    price = 2.0 * float(planner.weights.sum()) * 0.2**2
    plan = solve(
        planner, LAG, 0.0, 0.2, low=-50.0, high=50.0, smallest=1.0, move_cost=price, travel_cost=0.0
    )
    assert plan.times == ()
    assert plan.cost == plan.hold_cost
