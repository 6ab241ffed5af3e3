"""Whether the evidence is in all of the window: two explanations that differ in known rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from estimator import ReasonCode, Verdict, identify
from estimator.evidence.steadiness import steady_evidence
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.hypotheses.noise import WHITE
from estimator.processes.poles import Poles, Shape
from tests.seeds import in_suite

CaseOf = Callable[..., Case]
LAG = Poles(Shape.LAGS, 6.0)


def _explanation(case: Case, residual: np.ndarray) -> Hypothesis:
    """An explanation that leaves this much of PV, in white noise and at no price."""
    plain = case.fit(None, LAG, 2, (), WHITE, refit_noise=False)
    judged = residual * case.rows.weight
    squares = float(judged @ judged)
    likelihood = case.log_likelihood(squares)
    return replace(plain, residual=residual, squares=squares, likelihood=likelihood, taps=WHITE)


@pytest.mark.parametrize("seed", range(5))
def test_evidence_of_all_rows_loses_one_part_of_eight(loop, case: CaseOf, seed: int) -> None:
    window = case(*loop(None, samples=830)[:2])
    noise = np.random.default_rng(seed).normal(0.0, 0.1, window.rows.size)
    worse, better = _explanation(window, 1.3 * noise), _explanation(window, noise)
    evidence = better.likelihood - worse.likelihood
    # n log 1.3, and about an eighth of it is in the best part
    assert evidence == pytest.approx(800 * np.log(1.3), rel=0.01)
    assert steady_evidence(window, worse, better) == pytest.approx(7 / 8 * evidence, rel=0.05)


@pytest.mark.parametrize("seed", range(5))
def test_evidence_of_one_part_is_left_out(loop, case: CaseOf, seed: int) -> None:
    window = case(*loop(None, samples=830)[:2])
    noise = np.random.default_rng(seed).normal(0.0, 0.1, window.rows.size)
    jumped = noise.copy()
    jumped[440:470] += 0.5
    worse, better = _explanation(window, jumped), _explanation(window, noise)
    assert better.likelihood - worse.likelihood > 200.0
    assert steady_evidence(window, worse, better) == pytest.approx(0.0, abs=1e-6)


def test_a_stem_that_slips_in_one_part_and_rests_elsewhere_is_no_evidence_elsewhere(
    loop, case: CaseOf
) -> None:
    window = case(*loop(None, samples=830)[:2])
    noise = np.random.default_rng(1).normal(0.0, 0.1, window.rows.size)
    worse, better = _explanation(window, 1.3 * noise), _explanation(window, noise)
    rests = np.zeros(window.rows.size)
    rests[300:340] = 0.5
    once = replace(better, stem=rests)
    assert steady_evidence(window, worse, once) == 0.0
    rests = rests.copy()
    rests[700:] = 0.5
    again = replace(better, stem=rests)
    assert steady_evidence(window, worse, again) > 100.0


@pytest.mark.parametrize("seed", in_suite(2, range(5)))
def test_a_valve_that_moves_in_one_burst_of_op_is_not_sure(seed: int) -> None:
    rng = np.random.default_rng(seed)
    op = 50.0 + np.cumsum(rng.normal(0.0, 0.1, 1000))
    op -= np.linspace(0.0, op[-1] - 50.0, op.size)
    op[100:140] += 20.0 * np.sin(np.linspace(0.0, 4.0 * np.pi, 40))
    twice = op.copy()
    twice[700:740] += 20.0 * np.sin(np.linspace(0.0, 4.0 * np.pi, 40))
    noise = 0.1 * rng.normal(size=op.size)
    valve = Valve(12.0, 6.0, 50.0)
    once, both = (identify(u, LAG.response(valve.stem(u)) + noise) for u in (op, twice))
    assert once.evidence.log_bayes_factor > 20.0
    assert once.uncertain
    assert once.reasons[0].code is ReasonCode.EVIDENCE_IN_ONE_PART
    assert both.verdict is Verdict.STICTION
