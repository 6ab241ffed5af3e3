"""A load of steps and straight lines, of no period, is not taken for a sticky valve."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from estimator import Verdict, identify
from estimator.evidence.piecewise_loads import fit_piecewise_loads
from estimator.hypotheses.hypothesis import Case
from estimator.hypotheses.piecewise_load import CORNER_PRICE, Corner, PiecewiseLoad
from estimator.processes.poles import Poles, Shape
from loop_model import ValveModel
from tests.closed_loop import run, simulate
from tests.seeds import in_suite

Array = NDArray[np.float64]

LAG = Poles(Shape.LAGS, 6.0)


def load_steps(n: int, gap: float, seed: int) -> Array:
    """Steps at random times, ``gap`` samples apart on average."""
    rng = np.random.default_rng(seed)
    at = rng.random(n) < 1.0 / gap
    levels = rng.standard_normal(int(at.sum()) + 1)
    return levels[np.cumsum(at)]


@pytest.mark.parametrize("through", [LAG, Poles(Shape.LAGS, 6.0, 2.0, 1.5), None])
def test_its_column_is_the_response_to_a_course_of_steps_and_lines(through: Poles | None) -> None:
    n = 300
    # the same course, drawn through its corners: rises from row 20, steps at 90, falls from 150
    k = np.arange(n)
    course = np.maximum(0.0, k - 19.0) * 0.1 + 3.0 * (k >= 90) - np.maximum(0.0, k - 149.0) * 0.3
    expected = course
    for lag in () if through is None else (through.slow, through.fast, through.third):
        pole = np.exp(-1.0 / lag) if lag > 0.0 else 0.0
        expected = lfilter([1.0 - pole], [1.0, -pole], expected)
    corners = Corner(20, 0.1, 0.0), Corner(90, 0.0, 3.0), Corner(150, -0.3, 0.0)
    load = PiecewiseLoad(corners, through)
    column = load.columns(np.zeros(n), LAG, 0)[0]
    np.testing.assert_allclose(column, expected / np.abs(expected).max(), atol=1e-9)
    assert load.price(100.0) == pytest.approx(3 * CORNER_PRICE * np.log(100.0))


@pytest.mark.parametrize("at_valve", [True, False])
def test_it_is_found_with_the_process_behind_a_healthy_valve(case, at_valve: bool) -> None:
    rng = np.random.default_rng(5)
    n = 700
    op = np.repeat(rng.normal(size=70), 10)
    k = np.arange(n)
    load = 4.0 * (k >= 200) - 0.05 * np.maximum(0.0, k - 349.0) - 3.0 * (k >= 500)
    pole = np.exp(-1.0 / 6.0)
    late = [0.0, 0.0, 0.0, 1.0 - pole]
    if at_valve:
        pv = lfilter(late, [1.0, -pole], op) + lfilter([1.0 - pole], [1.0, -pole], load)
    else:
        pv = lfilter(late, [1.0, -pole], op) + load
    window: Case = case(op, pv + 0.02 * rng.normal(size=n), signed=False)
    wrong = window.fit(None, Poles(Shape.LAGS, 15.0), 0, (), np.zeros(0))
    found = fit_piecewise_loads(window, (wrong,), -np.inf)[0]
    (load_found,) = found.nuisances
    assert isinstance(load_found, PiecewiseLoad)
    assert (load_found.through is not None) == at_valve
    assert found.poles.slow == pytest.approx(6.0, rel=0.1)
    assert found.dead_time == 3
    rows = np.array([one.row for one in load_found.corners])
    assert all(np.abs(rows - true).min() < 10 for true in (200, 350, 500))
    assert all(min(abs(row - true) for true in (200, 350, 500)) < 10 for row in rows)
    sizes = {one.row: abs(one.step) for one in load_found.corners}
    assert sorted(sorted(sizes, key=lambda row: -sizes[row])[:2]) == [200, 500]


@pytest.mark.parametrize("seed", in_suite(2, range(1, 11)))
@pytest.mark.parametrize("at_valve", [True, False])
def test_a_healthy_valve_under_load_steps_is_not_accused(seed: int, at_valve: bool) -> None:
    steps = load_steps(900, 70.0, seed)
    where = {"load": 3.0 * steps} if at_valve else {"faults": 2.0 * steps}
    record = run(n=900, dead=4, noise=0.03, seed=seed, gain=0.5, **where)
    result = identify(record.op, record.pv, sp=record.sp)
    assert result.verdict is not Verdict.STICTION


@pytest.mark.parametrize("seed", in_suite(3, range(1, 7)))
def test_a_sticky_valve_under_load_steps_is_found(seed: int) -> None:
    steps = load_steps(900, 120.0, seed)
    record = run(load=2.0 * steps, n=900, band=6.0, jump=3.0, noise=0.03, seed=seed, gain=0.8)
    result = identify(record.op, record.pv, sp=record.sp)
    assert result.verdict is Verdict.STICTION
    assert result.stick_band.value == pytest.approx(6.0, rel=0.2)


@pytest.mark.parametrize("seed", in_suite(3, range(1, 7)))
def test_a_sticky_valve_alone_is_not_taken_for_one(seed: int) -> None:
    record = run(n=1200, band=5.0, jump=2.0, noise=0.05, seed=seed)
    result = identify(record.op, record.pv, sp=record.sp)
    assert result.verdict is Verdict.STICTION
    assert not result.uncertain


class UnevenValve:
    """A sticky valve whose friction is a little different at every slip."""

    def __init__(self, band: float, jump: float, seed: int) -> None:
        self._mean = band, jump
        self._rng = np.random.default_rng(seed)
        self._now = ValveModel(band, jump)

    def step(self, stem: float, op: float) -> float:
        moved = self._now.step(stem, op)
        if moved != stem:
            part = 1.0 + 0.08 * self._rng.standard_normal()
            self._now = ValveModel(*(part * size for size in self._mean))
        return moved


@pytest.mark.thorough
def test_few_uneven_slips_behind_a_rounded_op_are_not_taken_for_steps_of_a_load() -> None:
    """PV stays for long where a slip left it, and OP is of no effect: no load does that."""
    n, warm, pole = 700, 200, np.exp(-1.0 / 4.0)
    judged = healthy = sticky = 0
    for seed in range(1, 21):
        rng = np.random.default_rng(seed)
        op, pv, stem = simulate(
            np.full(n + warm, 1.0 + 0.15 * rng.standard_normal()),
            np.zeros(n + warm),
            0.03 * rng.standard_normal(n + warm),
            settings=(0.3, 6.0, 0.0),
            process=(pole, 1.0 - pole),
            dead_time=2,
            valve=UnevenValve(4.0, 2.0, seed),
        )
        if np.count_nonzero(np.diff(stem[warm:])) < 4:
            continue
        result = identify(np.round(op[warm:], 1), pv[warm:])
        judged += 1
        healthy += result.verdict is Verdict.NO_STICTION and not result.uncertain
        sticky += result.verdict is Verdict.STICTION and not result.uncertain
    assert judged >= 15
    assert healthy <= 1
    assert sticky >= 12
