"""Records that a historian held back, and values that measure nothing."""

from __future__ import annotations

import numpy as np
import pytest

from estimator import EstimatorError, ReasonCode, Verdict, identify
from estimator.arrays import Array
from estimator.evidence.records import drawn_step
from estimator.settings import SETTINGS


def _window(samples: int = 240) -> tuple[Array, Array]:
    rng = np.random.default_rng(7)
    k = np.arange(float(samples))
    op = 50.0 + 8.0 * np.sin(k / 7.0) + 2.0 * np.sin(k / 2.9) + 0.2 * rng.standard_normal(samples)
    pv = np.convolve(op, 0.2 * 0.8 ** np.arange(30.0))[:samples] + rng.standard_normal(samples)
    pv[100:110] = np.nan
    return op, pv


def _by_exception(signal: Array, step: float) -> Array:
    """Stored where it is a step from what was stored last, read back by straight lines."""
    kept = [0]
    for k in range(1, signal.size):
        if abs(signal[k] - signal[kept[-1]]) > step:
            kept.append(k)
    return np.asarray(np.interp(np.arange(signal.size), kept, signal[kept]), dtype=np.float64)


def test_the_step_of_a_record_by_exception_is_told() -> None:
    k = np.arange(2000.0)
    signal = np.sin(k / 40.0) + 0.4 * np.sin(k / 13.0)
    span = float(np.ptp(signal))
    told = drawn_step(_by_exception(signal, 0.05 * span))
    assert 0.05 <= told < 0.075
    assert drawn_step(signal) == 0.0


def test_what_a_historian_holds_back_is_no_sticky_valve() -> None:
    """A healthy loop, stored by exception: PV and OP stand a step behind, as a stem would."""
    rng = np.random.default_rng(1)
    load = np.zeros(900)
    for k in range(1, load.size):
        load[k] = 0.97 * load[k - 1] + 0.1 * rng.standard_normal()
    op, pv, y, integral = np.zeros(load.size), np.zeros(load.size), 0.0, 0.0
    for k in range(load.size):
        pv[k] = y + 0.1 * rng.standard_normal()
        integral -= 0.1 * pv[k]
        op[k] = integral - 0.8 * pv[k]
        y += (op[k] + load[k] - y) / 4.0
    op, pv = (_by_exception(one, step * np.ptp(one)) for one, step in ((op, 0.04), (pv, 0.09)))
    result = identify(op, pv)
    assert result.score > SETTINGS.judging.threshold, "the case this test is about"
    assert result.verdict is Verdict.NOT_ASSESSABLE
    assert result.reasons[0].code is ReasonCode.RECORD_INTERPOLATED
    assert result.evidence.left_out > 0.04


def test_a_number_beyond_all_measurements_is_a_bad_sample() -> None:
    op, pv = _window()
    whole = identify(op, pv).to_dict()
    pv[101] = np.finfo(np.float64).max
    told = identify(op, pv).to_dict()
    assert told["score"] == whole["score"]


def test_what_is_no_real_number_is_told() -> None:
    op, pv = _window()
    with pytest.raises(EstimatorError, match="op is complex"):
        identify(op + 0j, pv)
    with pytest.raises(EstimatorError, match=r"confidence is '0\.9'"):
        identify(op, pv, confidence="0.9")  # type: ignore[arg-type]
