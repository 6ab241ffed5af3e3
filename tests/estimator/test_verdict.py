"""From evidence to a verdict: what each test must say, and what is not enough."""

from __future__ import annotations

import math

import numpy as np
import pytest
from estimator.verdict import judge, score_of, simulated_evidence, strokes_of
from scipy.stats import norm

from estimator.outcomes import ReasonCode, Verdict
from estimator.result import Evidence, Fit

GOOD, POOR = Fit(0.95, 0.8), Fit(0.2, 0.1)


def _evidence(simulated: float, whitened: float, strokes: int = 12) -> Evidence:
    return Evidence(simulated, whitened, 100.0, 2 * strokes, strokes - 1, strokes, 0.4)


def _verdict(evidence: Evidence, fit: Fit = GOOD) -> tuple[Verdict, ReasonCode]:
    verdict, reasons = judge(score_of(evidence), evidence, fit)
    return verdict, reasons[0].code


def test_simulated_evidence_is_the_gaussian_likelihood_ratio_less_three_parameters() -> None:
    rng = np.random.default_rng(0)
    sticky, healthy = rng.normal(size=400), 1.3 * rng.normal(size=400)

    def likelihood(errors: np.ndarray) -> float:
        return float(norm.logpdf(errors, scale=np.sqrt(np.mean(errors**2))).sum())

    ratio = likelihood(sticky) - likelihood(healthy)
    found = simulated_evidence(float(healthy @ healthy), float(sticky @ sticky), 400.0)
    assert found == pytest.approx(ratio - 1.5 * math.log(400.0))


def test_both_tests_together_call_a_valve_sticky() -> None:
    assert _verdict(_evidence(8.0, 9.0)) == (
        Verdict.STICTION,
        ReasonCode.STICKY_VALVE_EXPLAINS,
    )
    assert _verdict(_evidence(5.0, 4.0))[0] is Verdict.NO_STICTION
    assert _verdict(_evidence(30.0, 2.0)) == (
        Verdict.NO_STICTION,
        ReasonCode.DISTURBANCE_EXPLAINS,
    )


@pytest.mark.parametrize(
    ("whitened", "strokes", "verdict"),
    [
        (24.5, 12, Verdict.STICTION),
        (23.5, 12, Verdict.NO_STICTION),
        (60.0, 5, Verdict.NO_STICTION),
    ],
)
def test_one_step_errors_alone_need_to_be_overwhelming_and_a_cycle(
    whitened: float, strokes: int, verdict: Verdict
) -> None:
    assert _verdict(_evidence(-4.0, whitened, strokes))[0] is verdict


def test_a_pv_that_nothing_explains_cannot_be_judged() -> None:
    assert _verdict(_evidence(8.0, 9.0), POOR) == (
        Verdict.NOT_ASSESSABLE,
        ReasonCode.NO_MODEL_EXPLAINS_PV,
    )


def test_one_stroke_is_a_step_and_no_evidence() -> None:
    once = _evidence(50.0, 50.0, strokes=1)
    assert score_of(once) == 0.0
    assert _verdict(once) == (Verdict.NOT_ASSESSABLE, ReasonCode.TOO_FEW_MOVES)
    assert _verdict(once, Fit(0.95, 0.93))[0] is Verdict.NO_STICTION


def test_a_whitened_test_that_speaks_against_takes_three_quarters_at_most() -> None:
    assert score_of(_evidence(20.0, -200.0)) == pytest.approx(5.0)
    assert score_of(_evidence(20.0, -2.0)) == pytest.approx(18.0)
    assert score_of(_evidence(0.5, 10.0)) == 0.0


def test_moves_that_follow_each_other_are_one_stroke() -> None:
    stem = np.zeros(500)
    stem[100:] += 1.0
    stem[103:] += 1.0
    assert strokes_of(stem) == 1
    stem[300:] += 1.0
    assert strokes_of(stem) == 2
    stem[302:] -= 1.0
    assert strokes_of(stem) == 3
    assert strokes_of(np.zeros(500)) == 0
