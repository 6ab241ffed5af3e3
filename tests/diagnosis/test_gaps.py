"""A controller that leaves small errors as they are is no hand, and not for that a slow one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from estimator.diagnosis.settings import DIAGNOSIS
from estimator.diagnosis.standing import gap_of, held_runs
from fieldlink.diagnosis import Diagnosis, diagnose
from tests.seeds import in_suite

Signals = tuple[np.ndarray, np.ndarray]


def loop_with_gap(gap: float, seed: int) -> Signals:
    """OP and PV: PI by SIMC on the error beyond the gap, a lag, dead time, a load that wanders."""
    rng = np.random.default_rng(seed)
    pole = math.exp(-1.0 / 12.0)
    y, u, last, load = 0.0, 50.0, 0.0, 0.0
    moved = [50.0] * 4
    op, pv = [], []
    for noise, push in rng.standard_normal((1500, 2)):
        error = -(y + 0.02 * noise)
        beyond = error - float(np.clip(error, -gap, gap))
        u += 0.8 * (beyond - last + beyond / 12.0)
        last = beyond
        load = 0.97 * load + 0.15 * push
        moved = [u, *moved[:-1]]
        op.append(u)
        pv.append(50.0 - error)
        y = pole * y + (1.0 - pole) * 1.5 * (moved[-1] - 50.0 + load)
    return np.array(op), np.array(pv)


def found(loop: Signals) -> Diagnosis:
    op, pv = loop
    return diagnose(op, pv, np.full(op.size, 50.0), period=1.0, advice=False)


@pytest.mark.parametrize("gap", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("seed", range(1, 6))
def test_the_gap_shows_in_the_errors_with_which_op_stands_still(gap: float, seed: int) -> None:
    op, pv = loop_with_gap(gap, seed)
    assert gap_of(op, 50.0 - pv, DIAGNOSIS.facts) == pytest.approx(gap, rel=0.1)
    assert held_runs(op, 50.0 - pv, None, 1.0, DIAGNOSIS.facts) == []


@pytest.mark.parametrize("gap", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("seed", in_suite(1, range(1, 6)))
def test_a_well_tuned_loop_with_a_gap_is_neither_in_manual_nor_slow(gap: float, seed: int) -> None:
    names = {cause.name for cause in found(loop_with_gap(gap, seed)).causes}
    assert names <= {"quiet", "undetermined"}


def test_what_cannot_be_told_beside_a_gap_says_so() -> None:
    answer = found(loop_with_gap(1.0, 1))
    assert "a gap of the controller" in answer.first.evidence[0]
    assert "gap" in answer.first.action


def test_a_hand_that_holds_op_beside_any_error_is_no_gap() -> None:
    op, pv = loop_with_gap(0.0, 1)
    op[400:1000] = op[400]
    assert math.isnan(gap_of(op, 50.0 - pv, DIAGNOSIS.facts))


def test_op_that_stands_still_without_an_error_shows_no_gap() -> None:
    error = np.round(np.random.default_rng(1).standard_normal(1200))
    op = 50.0 + np.cumsum(0.1 * error)
    assert math.isnan(gap_of(op, error, DIAGNOSIS.facts))
