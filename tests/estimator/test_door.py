"""What the door lets in, what it refuses, and what it says."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from estimator import EstimatorError, ReasonCode, Verdict, identify

N = 300
WAVE = np.sin(np.arange(N) / 8.0)


@pytest.mark.parametrize(
    ("op", "pv", "options", "words"),
    [
        (WAVE, WAVE[:-1], {}, "op has 300 samples and pv has 299"),
        (["a"] * N, WAVE, {}, "op is not numeric"),
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
    ],
)
def test_what_is_no_window_is_refused(op: object, pv: object, options: dict, words: str) -> None:
    with pytest.raises(EstimatorError, match=words.replace("(", r"\(").replace(")", r"\)")):
        identify(op, pv, **options)


@pytest.mark.parametrize(
    ("op", "pv", "options", "code"),
    [
        (WAVE[:40], WAVE[:40], {}, ReasonCode.TOO_FEW_SAMPLES),
        (np.full(N, 42.0), WAVE, {}, ReasonCode.OP_CONSTANT),
        (WAVE, np.full(N, 7.0), {}, ReasonCode.PV_FROZEN),
        (np.clip(WAVE, -2, -0.5), WAVE, {}, ReasonCode.OP_AT_LIMIT),
        (WAVE, np.clip(WAVE, -0.2, 2), {}, None),
        (WAVE, np.clip(WAVE, 0.3, 2), {}, ReasonCode.PV_AT_LIMIT),
        (WAVE, WAVE, {"auto": np.arange(N) > 250}, ReasonCode.NOT_IN_AUTOMATIC),
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


@pytest.mark.parametrize("pv", [WAVE, np.full(N, 1.0)], ids=["assessed", "not assessed"])
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
