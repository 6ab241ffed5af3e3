"""Sentences and advice follow from what was found; each is true for any reader."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.diagnosis_families.tuning.singles import draw_loop
from estimator.diagnosis.gather import find_swing
from estimator.diagnosis.loop_record import loop_record
from estimator.diagnosis.settings import DIAGNOSIS
from estimator.diagnosis.wording import digits
from fieldlink.diagnosis import diagnose


@pytest.mark.parametrize(
    ("value", "count", "text"),
    [(62.8037, 4, "62.8"), (54321.0, 4, "54320"), (100.0, 2, "100"), (0.0968, 2, "0.097")],
)
def test_no_powers_of_ten_in_a_sentence(value: float, count: int, text: str) -> None:
    assert digits(value, count) == text


def test_op_that_was_not_recorded_is_in_no_hand() -> None:
    n = np.arange(600)
    rng = np.random.default_rng(0)
    pv = 50.0 + 3.0 * np.sin(n / 10.0) + 0.2 * rng.standard_normal(n.size)
    op = np.where(n < 300, np.nan, 50.0 - 2.0 * np.sin(n / 10.0 + 1.0))
    found = diagnose(op, pv, np.full(n.size, 50.0), period=1.0, advice=False, figures=False)
    assert "manual" not in {cause.name for cause in found.causes}


def test_a_mode_that_was_not_recorded_is_told_as_such() -> None:
    n = np.arange(300)
    pv = 50.0 + 3.0 * np.sin(n / 10.0)
    flat = np.full(n.size, 40.0)
    inferred = diagnose(flat, pv, flat + 10.0, period=1.0).first
    recorded = diagnose(flat, pv, flat + 10.0, auto=np.zeros(n.size), period=1.0).first
    assert "the mode was not recorded" in inferred.evidence[0]
    assert recorded.evidence[0] == "the controller is in manual for 100% of the record"


def test_scattered_steps_of_the_setpoint_are_no_oscillation() -> None:
    rng = np.random.default_rng(5)
    sp = np.repeat(rng.uniform(-20.0, 20.0, 24), rng.integers(30, 90, 24))[:900]
    pv = np.convolve(sp, np.full(5, 0.2))[: sp.size] + 0.1 * rng.standard_normal(sp.size)
    found, _ = find_swing(loop_record(2.0 * pv, pv, sp, None, 1.0), DIAGNOSIS)
    assert not found.present


def test_a_level_that_cycles_slowly_needs_a_longer_integral_time() -> None:
    rng = np.random.default_rng(0)
    n = 1800
    load = np.zeros(n)
    for k in range(n):
        load[k] = 0.97 * load[k - 1] + 0.5 * rng.standard_normal()
    op, pv = np.full(n, 50.0), np.zeros(n)
    level = 0.0
    for k in range(n):
        level += 0.02 * ((op[k - 2] if k > 1 else 50.0) - 50.0 + load[k])
        pv[k] = level + 0.02 * rng.standard_normal()
        before = pv[k - 1] if k else 0.0
        op[k] = (op[k - 1] if k else 50.0) - 0.4 * (pv[k] - before + pv[k] / 8.0)
    first = diagnose(op, pv, np.zeros(n), period=1.0, advice=False, figures=False).first
    assert first.name == "tight_tuning"
    assert first.action.startswith("Lengthen the integral time")


def test_a_loop_of_too_much_gain_is_told_to_lower_it() -> None:
    loop = draw_loop(("tight_tuning",), 20024)
    signals = (loop.op, loop.pv, loop.sp)
    first = diagnose(*signals, period=loop.period, advice=False, figures=False).first
    assert first.name == "tight_tuning"
    assert first.action.startswith("Lower the controller's gain")
