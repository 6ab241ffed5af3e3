"""From evidence to a verdict: the threshold, the uncertain zone, and what is not enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.evidence.verdict import count_strokes, describe_stem, judge
from estimator.outcomes import ReasonCode, Verdict
from estimator.result import Evidence, Fit
from estimator.settings import SETTINGS

CLEAR = Evidence(
    log_bayes_factor=80.0,
    steady=60.0,
    effect=0.5,
    process=200.0,
    gain_deviations=20.0,
    disturbances=0,
    moves=24,
    reversals=11,
    strokes=12,
    band_over_span=0.4,
    informed=1.0,
    gain_sign=1,
    law="he",
)
THRESHOLD = SETTINGS.judging.threshold


def _judge(**changes: float) -> tuple[Verdict, ReasonCode, bool]:
    found = judge(replace(CLEAR, **changes), Fit(0.95, 0.8), SETTINGS)
    return found.verdict, found.reasons[0].code, found.uncertain


@pytest.mark.parametrize(
    ("changes", "verdict", "code"),
    [
        ({}, Verdict.STICTION, ReasonCode.STICKY_VALVE_EXPLAINS),
        ({"log_bayes_factor": -20.0}, Verdict.NO_STICTION, ReasonCode.HEALTHY_VALVE_SUFFICES),
        (
            {"log_bayes_factor": -20.0, "disturbances": 1},
            Verdict.NO_STICTION,
            ReasonCode.DISTURBANCE_EXPLAINS,
        ),
        (
            {"log_bayes_factor": -20.0, "process": 1.0},
            Verdict.NOT_ASSESSABLE,
            ReasonCode.NO_MODEL_EXPLAINS_PV,
        ),
        (
            {"log_bayes_factor": -20.0, "process": 9.0, "gain_deviations": 2.9},
            Verdict.NOT_ASSESSABLE,
            ReasonCode.NO_MODEL_EXPLAINS_PV,
        ),
        (
            {"log_bayes_factor": -20.0, "process": 9.0, "gain_deviations": 3.1},
            Verdict.NO_STICTION,
            ReasonCode.HEALTHY_VALVE_SUFFICES,
        ),
        (
            {"log_bayes_factor": -20.0, "process": 40.0, "gain_deviations": 2.0},
            Verdict.NO_STICTION,
            ReasonCode.HEALTHY_VALVE_SUFFICES,
        ),
        ({"strokes": 1}, Verdict.NOT_ASSESSABLE, ReasonCode.TOO_FEW_MOVES),
        (
            {"strokes": 3, "log_bayes_factor": 40.0},
            Verdict.NOT_ASSESSABLE,
            ReasonCode.TOO_FEW_MOVES,
        ),
        (
            {"strokes": 3, "log_bayes_factor": 60.0},
            Verdict.STICTION,
            ReasonCode.STICKY_VALVE_EXPLAINS,
        ),
        ({"band_over_span": 0.015}, Verdict.NO_STICTION, ReasonCode.BAND_TOO_SMALL),
        (
            {"band_over_span": 0.09, "left_out": 0.05},
            Verdict.NOT_ASSESSABLE,
            ReasonCode.RECORD_INTERPOLATED,
        ),
        (
            {"band_over_span": 0.11, "left_out": 0.05},
            Verdict.STICTION,
            ReasonCode.STICKY_VALVE_EXPLAINS,
        ),
    ],
    ids=[
        "clear",
        "healthy",
        "disturbed",
        "no process",
        "gain not told from zero",
        "gain told from zero",
        "slow process with an unsure gain",
        "single stroke",
        "few strokes",
        "few but clear",
        "small band",
        "band of a dead band",
        "band beyond a dead band",
    ],
)
def test_evidence_makes_a_verdict_with_its_reason(
    changes: dict[str, float], verdict: Verdict, code: ReasonCode
) -> None:
    assert _judge(**changes) == (verdict, code, False)


@pytest.mark.parametrize(
    ("beyond", "verdict", "uncertain"),
    [
        (0.0, Verdict.STICTION, False),
        (-0.1, Verdict.NO_STICTION, True),
        (0.1 - THRESHOLD, Verdict.NO_STICTION, True),
        (-0.1 - THRESHOLD, Verdict.NO_STICTION, False),
    ],
)
def test_below_the_threshold_the_other_verdict_is_called_possible(
    beyond: float, verdict: Verdict, uncertain: bool
) -> None:
    found = judge(replace(CLEAR, log_bayes_factor=THRESHOLD + beyond), Fit(0.9, 0.8), SETTINGS)
    assert (found.verdict, found.uncertain) == (verdict, uncertain)
    assert (ReasonCode.UNCERTAIN in {r.code for r in found.reasons}) is uncertain
    # something that would settle it
    assert all(reason.advice for reason in found.reasons)


def test_the_figures_of_a_reason_are_those_of_the_window() -> None:
    (reason,) = judge(replace(CLEAR, log_bayes_factor=31.4), Fit(0.95, 0.81), SETTINGS).reasons
    for figure in ("31.4", "0.950", "0.810", "12 strokes"):
        assert figure in reason.text


def test_moves_that_follow_each_other_in_one_direction_are_one_stroke() -> None:
    stem = np.zeros(500)
    stem[100:] += 1.0
    stem[103:] += 1.0
    assert count_strokes(stem) == 1
    stem[300:] += 1.0
    assert count_strokes(stem) == 1
    stem[302:] -= 1.0
    assert count_strokes(stem) == 2
    assert describe_stem(stem) == (4, 1, 2)
    assert describe_stem(np.zeros(500)) == (0, 0, 0)


def test_evidence_in_one_part_of_the_window_is_not_called() -> None:
    # one jump of the load may fall on a slip of some valve
    found = judge(replace(CLEAR, steady=SETTINGS.judging.steady - 0.1), Fit(0.9, 0.8), SETTINGS)
    assert (found.verdict, found.uncertain) == (Verdict.NO_STICTION, True)
    codes = [reason.code for reason in found.reasons]
    assert codes == [ReasonCode.EVIDENCE_IN_ONE_PART, ReasonCode.UNCERTAIN]


def test_sticking_that_makes_little_of_pv_is_not_called_with_certainty() -> None:
    found = judge(replace(CLEAR, effect=0.0004), Fit(0.95, 0.8), SETTINGS)
    assert found.verdict is Verdict.STICTION
    assert found.uncertain
    assert "0.04% of PV's variance" in str(found.reasons[-1])
    assert not _judge(effect=0.02)[2]
