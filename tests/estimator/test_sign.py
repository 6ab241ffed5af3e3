"""The sign of the process gain: told by the controller's action, and held by both valves."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from benchmarks.examples import EXAMPLES, example_window
from benchmarks.families.tuning import draw
from estimator import Verdict, identify
from estimator.arrays import Array
from estimator.cleaning import clean
from estimator.evidence.sign import controller_action, gain_sign, soonest_answer
from estimator.evidence.weighing import weigh
from estimator.hypotheses.hypothesis import Case
from estimator.settings import SETTINGS
from estimator.window import carry_on
from loop_model import ValveModel
from tests.seeds import few_and_all

CaseOf = Callable[..., Case]


@pytest.fixture(scope="module")
def constant():
    """Example 2 at constant set-point: its controller, read backwards, is a good process."""
    return [example_window(EXAMPLES[1], seed, constant=True) for seed in (0, 1)]


def test_a_controller_read_backwards_is_no_healthy_process(constant) -> None:
    for window in constant:
        result = identify(window.op, window.pv)
        assert result.verdict is Verdict.STICTION
        assert result.process.gain > 0.0
        assert result.evidence.gain_sign == 1


def test_without_the_sign_the_backwards_controller_is_what_fits(constant, case: CaseOf) -> None:
    window = constant[0]
    free = weigh(case(window.op, window.pv, signed=False))
    held = weigh(case(window.op, window.pv))
    assert free.healthy.gain < 0.0 < held.healthy.gain
    # what the sign forbids is likelier, and wrong: this is why it is needed
    assert free.healthy.likelihood > held.healthy.likelihood + 10.0


@pytest.mark.parametrize("mirror", [1.0, -1.0])
@pytest.mark.parametrize("valve", [None, ValveModel(5.0, 2.0)], ids=["healthy", "sticky"])
def test_both_valves_have_the_sign_that_the_controller_tells(
    loop, case: CaseOf, valve, mirror: float
) -> None:
    op, pv, _ = loop(valve, samples=500, noise=0.2, drift=0.05)
    found = weigh(case(op, mirror * pv))
    assert found.sticky is not None
    for one in (found.healthy, found.sticky):
        assert mirror * one.gain >= 0.0


def test_the_action_is_the_t_value_of_a_regression(loop) -> None:
    # of OP's moves on the last four errors and its own last two, by NumPy; means taken out
    op, pv, _ = loop(None, samples=300, noise=0.3)
    op = op + 0.2 * np.random.default_rng(1).normal(size=300)  # a PI alone leaves nothing over
    setpoint = np.full(300, 7.0)
    error = setpoint - pv
    steps = np.diff(op)
    errors = [error[3 - i : 300 - i] for i in range(4)]
    past = np.stack([*errors, steps[1:-1], steps[:-2]], axis=1)
    moves = steps[2:]
    past, moves = past - past.mean(axis=0), moves - moves.mean()
    shares, left, *_ = np.linalg.lstsq(past, moves)
    spread = left[0] / moves.size * np.linalg.inv(past.T @ past)[:4, :4].sum()
    expected = shares[:4].sum() / np.sqrt(spread)
    for sp in (setpoint, None):  # a constant set-point tells nothing more
        assert controller_action(op, pv, sp) == pytest.approx(expected, rel=1e-5)
    assert controller_action(op, -pv, None) == pytest.approx(-expected, rel=1e-5)


def test_the_set_point_tells_the_action_where_it_moves(loop) -> None:
    op, pv, _ = loop(None, samples=600, noise=0.05, setpoints=(7.0, 11.0, 5.0, 9.0))
    # 1,200 samples of which the last 600 are the window: two of the four set-points
    setpoint = np.array([(5.0, 9.0)[k >= 300] for k in range(600)])
    assert controller_action(op, pv, setpoint) > 2.0 * abs(controller_action(op, pv, None))


def test_a_set_point_with_lost_samples_tells_the_action_as_well(loop) -> None:
    # a lost poll takes OP, PV and SP alike; a single one made the set-point count as constant
    op, pv, _ = loop(None, samples=600, noise=0.05, setpoints=(7.0, 11.0, 5.0, 9.0))
    setpoint = np.array([(5.0, 9.0)[k >= 300] for k in range(600)])
    constant = controller_action(op, pv, None)
    for seed in range(20):
        lost = np.random.default_rng(seed).random(600) < 0.1
        lost[299:304] = False  # the step itself is seen
        kept = [np.where(lost, np.nan, signal) for signal in (op, pv, setpoint)]
        assert controller_action(*kept) > 2.0 * abs(constant)
    nowhere = np.full(600, np.nan)
    assert controller_action(op, pv, nowhere) == constant


def test_a_set_point_stored_where_it_changes_is_the_set_point(loop) -> None:
    op, pv, _ = loop(None, samples=600, noise=0.05, setpoints=(7.0, 11.0, 5.0, 9.0))
    setpoint = np.array([(5.0, 9.0)[k >= 300] for k in range(600)])
    changes = np.full(600, np.nan)
    changes[[0, 300]] = 5.0, 9.0
    assert controller_action(op, pv, changes) == controller_action(op, pv, setpoint)
    assert np.array_equal(carry_on(changes), setpoint)
    # the first value that is known also counts before it
    changes[0], changes[120] = np.nan, 5.0
    assert np.array_equal(carry_on(changes), setpoint)
    assert carry_on(np.full(600, np.nan)) is None


def test_op_that_no_controller_moves_tells_no_sign() -> None:
    rng = np.random.default_rng(0)
    actions = [
        controller_action(np.cumsum(rng.normal(size=400)), rng.normal(size=400), None)
        for _ in range(50)
    ]
    assert np.abs(actions).max() < 4.0
    assert np.std(actions) == pytest.approx(1.0, abs=0.3)


def _smith_loop(
    valve: ValveModel | None, seed: int, dead_time: int = 10
) -> tuple[Array, Array, Array]:
    """OP, PV and SP, ``(700,)``, of a lag behind a dead time under Smith's predictor (a PI on the
    error that its model says will be left when all of OP's moves have arrived).
    """
    rng = np.random.default_rng(seed)
    pole, settling, n = 0.93, 300, 1_000
    op, pv, sp = np.zeros(n), np.zeros(n), np.full(n, 7.0)
    stem = y = soon = before = 0.0
    ahead = np.zeros(n)
    moved = [0.0] * dead_time
    for k in range(1, n):
        moved.append(stem)
        y = pole * y + (1.0 - pole) * moved[-dead_time - 1]
        pv[k] = y + 0.05 * rng.normal()
        # the model's PV without dead time, and with it
        ahead[k] = pole * ahead[k - 1] + (1.0 - pole) * op[k - 1]
        soon = ahead[k] - ahead[max(0, k - dead_time)]
        error = sp[k] - pv[k] - soon
        op[k] = op[k - 1] + 1.5 * (error - before + (1.0 - pole) * error)
        before = error
        stem = op[k] if valve is None else valve.step(stem, op[k])
    return op[settling:], pv[settling:], sp[settling:]


@pytest.mark.parametrize("valve", [None, ValveModel(5.0, 2.0)], ids=["healthy", "sticky"])
def test_a_predictive_controller_behind_a_long_dead_time_tells_the_sign(valve) -> None:
    for seed in range(20):
        op, pv, sp = _smith_loop(valve, seed)
        assert controller_action(op, pv, sp) > 20.0
        assert controller_action(op, -pv, -sp) < -20.0


def _moved(signal: Array, late: int) -> Array:
    """A column ``(n,)`` that is recorded so many samples late."""
    return np.concatenate([np.full(late, signal[0]), signal[: signal.size - late]])


def _sign(op: Array, pv: Array) -> float:
    found = clean(op, pv, None, SETTINGS.screening)
    return gain_sign(op, found.pv, None, found.controller, SETTINGS.modelling)


@pytest.mark.parametrize("valve", [None, ValveModel(5.0, 2.0)], ids=["healthy", "sticky"])
@pytest.mark.parametrize(("op_late", "pv_late"), [(0, 0), (1, 0), (0, 1), (0, 2)])
@pytest.mark.parametrize("seeds", few_and_all(6, range(20)))
def test_columns_that_are_stored_one_after_the_other_tell_the_sign(
    loop, valve, op_late: int, pv_late: int, seeds: Sequence[int]
) -> None:
    for seed in seeds:
        op, pv, _ = loop(valve, samples=500, noise=0.2, drift=0.05, seed=seed)
        for mirror in (1.0, -1.0):
            assert _sign(_moved(op, op_late), mirror * _moved(pv, pv_late)) == mirror


@pytest.mark.parametrize("seeds", few_and_all(1, range(5)))
def test_a_sticky_valve_is_found_where_pv_is_stored_a_sample_late(
    loop, seeds: Sequence[int]
) -> None:
    for seed in seeds:
        op, pv, _ = loop(ValveModel(5.0, 2.0), samples=600, noise=0.1, seed=seed)
        found, as_seen = identify(op, _moved(pv, 1)), identify(op, pv)
        assert found.verdict is Verdict.STICTION
        assert found.stick_band.value == pytest.approx(as_seen.stick_band.value, rel=0.02)
        assert "recorded 1 sample after the OP" in found.identifiability[-1]


def test_op_in_manual_tells_no_sign() -> None:
    # steps and a binary test signal, answered by a process and by no controller
    for seed in range(20):
        rng = np.random.default_rng(seed)
        for op in (
            np.repeat(np.sign(rng.normal(size=75)), 8),
            np.sign(np.sin(np.arange(600) / 9.0)),
        ):
            pv = np.zeros(600)
            for k in range(4, 600):
                pv[k] = 0.9 * pv[k - 1] + 0.1 * op[k - 4]
            pv += 0.02 * rng.normal(size=600)
            assert _sign(op, pv) == 0.0


@pytest.mark.parametrize("valve", [None, ValveModel(5.0, 2.0)], ids=["healthy", "sticky"])
def test_only_op_that_answers_earlier_samples_leaves_room_for_no_dead_time(loop, valve) -> None:
    modelling = SETTINGS.modelling
    for seed in range(20):
        op, pv, _ = loop(valve, samples=500, noise=0.2, drift=0.05, seed=seed)
        for mirror in (1.0, -1.0):
            assert soonest_answer(op, mirror * pv, None, mirror, modelling) == 1
            # a log that stores OP with the PV that came of it
            assert soonest_answer(op[:-1], mirror * pv[1:], None, mirror, modelling) == 0
        assert soonest_answer(op, pv, None, 0.0, modelling) == 1


@pytest.mark.parametrize(
    ("kind", "seed"),
    [("cascade", 80021), ("cascade", 80022), ("cascade", 80030), ("sensor-lag", 80034)],
)
def test_the_controller_is_no_process_without_dead_time(kind: str, seed: int) -> None:
    # the slaves' set-points are not recorded and hide the sign; backwards, their controllers
    # explain PV by 700 to 2,400 nats more than the valve, that of the slow sensor by 63
    loop = draw(kind, True, seed)
    found = identify(loop.op, loop.pv, sp=loop.sp, period=loop.period)
    assert found.verdict is Verdict.STICTION
    assert found.evidence.log_bayes_factor > 100.0
    assert found.stick_band.value == pytest.approx(loop.stick_band, rel=0.02)
