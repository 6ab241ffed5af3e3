"""Whether the evidence is in all of the window: two explanations that differ in known rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from estimator.evidence.steadiness import steady_evidence
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.noise import WHITE
from estimator.processes.poles import Poles, Shape

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
