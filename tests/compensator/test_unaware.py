"""The unaware MPC against the regulator, against SciPy's optimiser, and on the paper's loops."""

import math

import numpy as np
import pytest
from scipy import linalg, optimize

from compensator import ActionStatus, CompensatorError, MpcSettings, OpLimits, UnawareMpc
from fieldlink.lab.study.closed_loop import EXAMPLE_1, EXAMPLE_2, Study, assess, held_stem_std, run
from loop_model import LoopModel, ProcessModel

FOPDT = ProcessModel((-0.85,), (0.3,), 5, 1.0, 1.0)
LEVEL = ProcessModel((-1.0,), (0.05,), 2, -1.5, 1.0)


@pytest.mark.parametrize("process", [EXAMPLE_1.process, FOPDT])
def test_without_active_limits_it_is_the_regulator_of_scipy(process: ProcessModel) -> None:
    mpc = UnawareMpc(process, MpcSettings(limits=OpLimits(-1e6, 1e6)))
    mpc.observe(process.gain * 50.0 + process.offset / (1.0 + sum(process.a)), 50.0)
    action = mpc.decide(process.gain * 50.0 + 3.0)
    p = mpc.prediction
    stage = np.zeros((p.order, p.order))
    stage[0, 0] = 1.0
    weight = np.array([[mpc.settings.op_weight * process.gain**2]])
    cost = linalg.solve_discrete_are(p.A, p.B[:, None], stage, weight)
    gain = np.linalg.solve(weight + p.B[None, :] @ cost @ p.B[:, None], p.B[None, :] @ cost @ p.A)
    here, _ = p.equilibrium(process.gain * 50.0, 0.0)
    shift = process.offset / (1.0 + sum(process.a))
    there, target = p.equilibrium(process.gain * 50.0 + 3.0 - shift, 0.0)
    assert action.op == pytest.approx(target - (gain @ (here - there)).item(), rel=1e-6)


@pytest.mark.parametrize("rate", [math.inf, 1.5])
def test_the_programme_s_optimum_is_scipy_s(rate: float) -> None:
    limits = OpLimits(48.0, 56.0, rate)
    mpc = UnawareMpc(EXAMPLE_1.process, MpcSettings(horizon=12, limits=limits))
    rest = EXAMPLE_1.process.gain * 50.0
    mpc.observe(rest, 50.0)
    action = mpc.decide(rest + 5.0)
    p = mpc.prediction
    target_state, target = p.equilibrium(rest + 5.0, 0.0)
    state0, _ = p.equilibrium(rest, 0.0)
    r = mpc.settings.op_weight * EXAMPLE_1.process.gain**2
    stage = np.zeros((p.order, p.order))
    stage[0, 0] = 1.0
    terminal = linalg.solve_discrete_are(p.A, p.B[:, None], stage, np.array([[r]]))

    def cost(ops: np.ndarray) -> float:
        state, total = state0, 0.0
        for i, op in enumerate(ops):
            state = p.A @ state + p.B * op
            gap = state - target_state
            weight = terminal if i == ops.size - 1 else stage
            total += float(gap @ weight @ gap) + r * (op - target) ** 2
        return total

    difference = np.eye(12) - np.eye(12, k=-1)
    first = np.zeros(12)
    first[0] = 50.0
    constraints = []
    if math.isfinite(rate):
        constraints = [optimize.LinearConstraint(difference, first - rate, first + rate)]
    best = optimize.minimize(
        cost,
        np.full(12, 50.0),
        method="SLSQP",
        bounds=[(48.0, 56.0)] * 12,
        constraints=constraints,
        options={"maxiter": 500, "ftol": 1e-13},
    )
    assert best.success
    assert action.op == pytest.approx(best.x[0], abs=1e-4)
    assert action.op < 56.0 + 1e-12


@pytest.mark.parametrize("process", [EXAMPLE_2.process, FOPDT, LEVEL])
def test_it_leaves_no_offset_under_load_and_model_error(process: ProcessModel) -> None:
    wrong = ProcessModel(
        process.a, tuple(1.2 * b for b in process.b), process.dead_time, 0.0, process.period
    )
    start = -process.offset / sum(process.b) if process.is_integrating else 50.0
    rest = 0.0
    if not process.is_integrating:
        rest = process.gain * 50.0 + process.offset / (1.0 + sum(process.a))
    study = Study([(0, rest), (20, rest + 4.0)], 400, load=[(200, 3.0)], op0=start)
    trace = run(process, None, UnawareMpc(wrong), study)
    assert trace.pv[-1] == pytest.approx(rest + 4.0, abs=1e-3)


@pytest.mark.parametrize(
    ("example", "noise", "healthy", "sticky"),
    [(EXAMPLE_1, 0.01, 0.10, 1.0), (EXAMPLE_2, 10**-1.5, 0.29, 0.85)],
)
def test_the_sticky_valve_makes_the_paper_s_limit_cycle(
    example: LoopModel, noise: float, healthy: float, sticky: float
) -> None:
    start = example.process.gain * 50.0
    study = Study([(0, start), (10, start + 2.0)], 1000, equation_noise=noise, seed=4)
    good = assess(run(example.process, None, UnawareMpc(example.process), study), 100)
    bad = assess(run(example.process, example.valve, UnawareMpc(example.process), study), 100)
    assert good.pv_std == pytest.approx(healthy, rel=0.2)
    assert bad.pv_std == pytest.approx(sticky, rel=0.25)
    assert bad.reversals >= 15
    assert 200.0 < bad.op_travel < 340.0


def test_the_stem_held_gives_the_known_deviations() -> None:
    assert held_stem_std(EXAMPLE_1.process, 0.01, 0.0) == pytest.approx(0.16, abs=0.005)
    assert held_stem_std(EXAMPLE_2.process, 10**-1.5, 0.0) == pytest.approx(0.51, abs=0.005)


def test_a_setpoint_out_of_reach_is_approached_and_said_so() -> None:
    mpc = UnawareMpc(FOPDT, MpcSettings(limits=OpLimits(0.0, 60.0)))
    trace = run(FOPDT, None, mpc, Study([(0, 107.0), (5, 200.0)], 200))
    assert trace.op[-1] == pytest.approx(60.0)
    assert trace.pv[-1] == pytest.approx(FOPDT.gain * 60.0 + 1.0 / 0.15)
    assert trace.status[-1] is ActionStatus.LIMITED


def test_pv_limits_hold_where_they_can() -> None:
    rest = EXAMPLE_1.process.gain * 50.0
    study = Study([(0, rest), (5, rest + 5.0)], 80)
    free = run(EXAMPLE_1.process, None, UnawareMpc(EXAMPLE_1.process), study)
    limit = rest + 5.0 + 0.3 * (free.pv.max() - rest - 5.0)
    limited = UnawareMpc(EXAMPLE_1.process, MpcSettings(pv_high=limit))
    trace = run(EXAMPLE_1.process, None, limited, study)
    assert free.pv.max() > limit + 0.01
    assert trace.pv.max() < limit + 0.005


def test_a_bad_pv_holds_op_and_returns_without_a_jump() -> None:
    rest = EXAMPLE_1.process.gain * 50.0
    study = Study([(0, rest)], 100, bad_pv=frozenset(range(30, 50)))
    trace = run(EXAMPLE_1.process, None, UnawareMpc(EXAMPLE_1.process), study)
    assert all(trace.status[k] is ActionStatus.PV_BAD for k in range(30, 50))
    np.testing.assert_allclose(trace.op, 50.0, atol=1e-6)


def test_before_the_first_observation_it_says_so() -> None:
    action = UnawareMpc(FOPDT).decide(1.0)
    assert action.status is ActionStatus.NOT_READY
    assert math.isnan(action.op)


def test_bad_settings_name_the_value() -> None:
    with pytest.raises(CompensatorError, match="low < high"):
        OpLimits(5.0, 5.0)
    with pytest.raises(CompensatorError, match="horizon"):
        MpcSettings(horizon=1)
    with pytest.raises(CompensatorError, match="op_weight"):
        MpcSettings(op_weight=0.0)
    with pytest.raises(CompensatorError, match="op"):
        UnawareMpc(FOPDT).observe(1.0, math.nan)
