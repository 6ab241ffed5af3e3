"""What the door lets in, what it refuses, and what it says."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pandas as pd
import pytest

from estimator import EstimatorError, ReasonCode, Verdict, identify
from estimator.window import period_of
from fieldlink.diagnosis import diagnose

N = 300
WAVE = np.sin(np.arange(N) / 8.0)
ANSWER = 0.5 * np.roll(WAVE, 3)


@pytest.mark.parametrize(
    ("op", "pv", "options", "words"),
    [
        (WAVE, WAVE[:-1], {}, "op has 300 samples and pv has 299"),
        (["a"] * N, WAVE, {}, "op is not numeric"),
        (pd.Series([pd.NA, *WAVE[1:]], dtype=object), WAVE, {}, "pandas.to_numeric(op, "),
        (pd.date_range("2026", periods=N), WAVE, {}, "op holds times"),
        (WAVE, WAVE.copy(), {}, "op and pv are the same samples"),
        (WAVE, WAVE, {"period": np.timedelta64(1, "s")}, "give the seconds between samples"),
        (WAVE.reshape(2, -1), WAVE, {}, "shape (2, 150)"),
        (WAVE, np.full(N, np.nan), {}, "pv has no finite sample"),
        ([], [], {}, "a window of 0 samples is too short"),
        (WAVE, WAVE, {"period": 0.0}, "period"),
        (WAVE, WAVE, {"criterion": "guess"}, "choose one of"),
        (WAVE, WAVE, {"method": "guess"}, "choose one of"),
        (WAVE, WAVE, {"criterion": "oe", "method": "grid"}, "use criterion 'arx' or 'auto'"),
        (WAVE, WAVE, {"criterion": "oe", "method": "nlp"}, "or method 'search'"),
        (WAVE, WAVE, {"confidence": 1.5}, "confidence"),
        (WAVE, WAVE, {"auto": np.ones(3)}, "auto has 3"),
        (WAVE, WAVE, {"auto": ["AUTO"] * N}, "auto is not numeric: give 1 where"),
    ],
)
def test_what_is_no_window_is_refused(op: object, pv: object, options: dict, words: str) -> None:
    with pytest.raises(EstimatorError, match=words.replace("(", r"\(").replace(")", r"\)")):
        identify(op, pv, **options)


def _series(values: Any, *, every: str = "2s", start: str = "2026-03-01", **options: Any) -> Any:
    times = pd.date_range(start, periods=len(values), freq=every, **options)
    return pd.Series(np.asarray(values), index=times)


@pytest.mark.parametrize(
    ("every", "period"), [("2s", 2.0), ("500ms", 0.5), ("1min", 60.0), ("1s", 1.0)]
)
def test_the_period_is_that_of_a_series_times(every: str, period: float) -> None:
    op = _series(WAVE, every=every)
    for index in (op.index, op.index.tz_localize("UTC"), op.index - op.index[0]):
        assert period_of(None, pd.Series(WAVE, index=index)) == period
    assert period_of(None, None, WAVE, op) == period
    assert period_of(period, op) == period


def test_without_times_the_period_is_a_second() -> None:
    for signal in (WAVE, list(WAVE), pd.Series(WAVE), np.ma.array(WAVE)):
        assert period_of(None, signal) == 1.0
        assert period_of(3.0, signal) == 3.0


def test_times_that_are_rounded_to_seconds_tell_the_period_between() -> None:
    for period in (1.5, 2.5):
        times = pd.to_timedelta(period * np.arange(N), "s")
        index = (pd.Timestamp("2026-03-01") + times).floor("s")
        assert period_of(None, pd.Series(WAVE, index=index)) == pytest.approx(period, rel=1e-2)
        assert period_of(period, pd.Series(WAVE, index=index)) == period


def test_series_are_not_joined_by_place() -> None:
    op, later = _series(WAVE), _series(WAVE, start="2026-03-02")
    for function in (identify, diagnose):
        with pytest.raises(EstimatorError, match=r"op and pv have different indexes.*concat"):
            function(op, later)
        with pytest.raises(EstimatorError, match="op and sp have different indexes"):
            function(op, WAVE, sp=pd.Series(WAVE))


def test_a_period_that_the_times_contradict_is_refused() -> None:
    op = _series(WAVE)
    for function in (identify, diagnose):
        with pytest.raises(EstimatorError, match=r"period is 1 s and the times .* are 2 s apart"):
            function(op, op, period=1.0)


def test_times_in_uneven_steps_are_refused_with_the_row_and_a_remedy() -> None:
    op = _series(WAVE)
    gap = op.drop(op.index[100])
    with pytest.raises(EstimatorError, match=r"2[.\d]* s apart, and 4 s before row 100 .*asfreq"):
        identify(gap, gap)
    with pytest.raises(EstimatorError, match=r"2[.\d]* s apart, and 4 s before row 100"):
        diagnose(gap, gap, period=2.0)
    twice = pd.concat([op[:100], op[99:]])
    with pytest.raises(EstimatorError, match=r"do not rise at row 100 .*sort"):
        identify(twice, twice)


def test_a_series_with_times_is_judged_as_its_samples_are() -> None:
    named = identify(_series(WAVE), _series(ANSWER)).to_dict()
    plain = identify(WAVE, ANSWER, period=2.0).to_dict()
    assert {**named, "seconds": 0} == {**plain, "seconds": 0}


@pytest.mark.parametrize(
    ("op", "pv", "options", "code"),
    [
        (WAVE[:40], ANSWER[:40], {}, ReasonCode.TOO_FEW_SAMPLES),
        (np.full(N, 42.0), WAVE, {}, ReasonCode.OP_CONSTANT),
        (WAVE, np.full(N, 7.0), {}, ReasonCode.PV_FROZEN),
        (np.clip(WAVE, -2, -0.5), WAVE, {}, ReasonCode.OP_AT_LIMIT),
        (WAVE, np.clip(WAVE, -0.2, 2), {}, None),
        (WAVE, np.clip(WAVE, 0.3, 2), {}, ReasonCode.PV_AT_LIMIT),
        (WAVE, ANSWER, {"auto": np.arange(N) > 250}, ReasonCode.NOT_IN_AUTOMATIC),
        (
            WAVE,
            np.where(np.arange(N) % 2, WAVE, np.nan),
            {},
            ReasonCode.TOO_MANY_BAD_SAMPLES,
        ),
        (
            WAVE,
            np.random.default_rng(0).normal(size=N),
            {},
            ReasonCode.NO_MODEL_EXPLAINS_PV,
        ),
    ],
)
def test_what_cannot_be_judged_is_named(
    op: np.ndarray, pv: np.ndarray, options: dict, code: ReasonCode | None
) -> None:
    result = identify(op, pv, **options)
    codes = [reason.code for reason in result.reasons]
    if code is None:
        assert result.verdict is not Verdict.NOT_ASSESSABLE
        return
    assert result.verdict is Verdict.NOT_ASSESSABLE
    assert code in codes
    assert all(reason.advice for reason in result.reasons)


def test_every_reason_has_advice() -> None:
    assert all(code.advice.endswith(".") for code in ReasonCode)


@pytest.mark.parametrize("pv", [ANSWER, np.full(N, 1.0)], ids=["assessed", "not assessed"])
def test_json_contract(pv: np.ndarray) -> None:
    found = identify(WAVE, pv, period=10.0).to_dict()
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    interval = {"value", "low", "high"}
    for key in ("stick_band", "slip_jump", "static_friction", "dynamic_friction"):
        assert set(found[key]) == interval
    assert set(found["process"]) == {"structure", "parameters", "dead_time_samples", "gain"}
    assert set(found["fit"]) == {"r2", "r2_healthy_valve"}
    assert found["samples"] == N
    assert found["period_s"] == 10.0
    assert found["confidence"] == 0.9
    assert found["verdict"] in {"stiction", "no_stiction", "not_assessable"}
    assert all(isinstance(text, str) for text in found["reasons"])
    assert found["reason_codes"] == [ReasonCode(code).value for code in found["reason_codes"]]
    assert len(found["advice"]) == len(found["reason_codes"]) == len(found["reasons"]) > 0
    assert isinstance(found["uncertain"], bool)
    assert {"log_bayes_factor", "effect", "informed", "gain_sign", "law"} <= set(found["evidence"])
    assert isinstance(found["identifiability"], list)
    for one in found["runners_up"]:
        assert set(one) == {"explanation", "structure", "dead_time_samples", "behind"}


def test_numbers_without_meaning_are_null() -> None:
    result = identify(WAVE, np.full(N, 1.0))
    assert math.isnan(result.stick_band.value)
    assert result.to_dict()["stick_band"] == {"value": None, "low": None, "high": None}
    assert result.model is None
