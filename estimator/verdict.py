"""From evidence to a verdict."""

from __future__ import annotations

import math

import numpy as np

from estimator._kernels import Array
from estimator.outcomes import Reason, ReasonCode, Verdict
from estimator.result import Evidence, Fit

__all__ = ["evidence_of", "judge", "score_of", "simulated_evidence", "strokes_of"]

_STICTION = 12.0
"""Log Bayes factors of both tests together; 5 alone is called decisive (Kass and Raftery, 1995)."""

_EACH = (1.0, 3.0)
"""What the simulated and the whitened test must say at least, each for itself."""

_OVERWHELMING = 24.0
"""The whitened test alone: loops whose noise hides the valve from simulation (closed loop).

Some 40,000 valves and a dozen dead times are tried, so that chance alone is worth about 13; the
healthy loops of `benchmarks.industrial` reach 23 (PAP4), those of `benchmarks.robustness` rarely 2.
"""

_CYCLE = 6
"""Strokes that the whitened test needs to speak alone: fewer are no cycle."""

_AGAINST = 0.75
_MIN_R2 = 0.3
_GOOD_R2 = 0.9
_MIN_STROKES = 2
_VALVE_PARAMETERS = 3
_STILL = 1e-9


def simulated_evidence(healthy_cost: float, sticky_cost: float, samples: float) -> float:
    """Log Bayes factor of a sticky over a healthy valve from their simulation errors.

    BIC's approximation: the log-likelihood ratio less ``3/2 log n`` for S, J and the first
    position, with ``n`` effective samples.
    """
    ratio = 0.5 * samples * math.log(max(healthy_cost, sticky_cost) / sticky_cost)
    return ratio - 0.5 * _VALVE_PARAMETERS * math.log(samples)


def evidence_of(
    stem: Array, simulated: float, whitened: float, samples: float, band: float
) -> Evidence:
    """The evidence; ``stem`` and ``band`` are in shares of OP's span."""
    steps = np.diff(stem)
    moved = steps[np.abs(steps) > _STILL]
    reversals = int((np.sign(moved[1:]) != np.sign(moved[:-1])).sum())
    return Evidence(
        simulated, whitened, samples, int(moved.size), reversals, strokes_of(stem), band
    )


def score_of(evidence: Evidence) -> float:
    """Evidence for stiction: the two log Bayes factors added.

    Zero where the stem makes a single stroke, and where simulation does not favour a sticky valve
    unless the whitened test is overwhelming. A whitened test that speaks against takes away three
    quarters at most, because a clean, slow PV gives it little to see.
    """
    if evidence.strokes < _MIN_STROKES:
        return 0.0
    if evidence.simulated < _EACH[0]:
        return evidence.whitened if _alone(evidence) else 0.0
    return evidence.simulated + max(evidence.whitened, -_AGAINST * evidence.simulated)


def _alone(evidence: Evidence) -> bool:
    """Whether the whitened test needs no support from simulation."""
    return evidence.whitened >= _OVERWHELMING and evidence.strokes >= _CYCLE


def strokes_of(stem: Array) -> int:
    """Strokes of the stem: moves in one direction that follow each other within 2 % of the window.

    One stroke is a step: anything that happens once in the window explains it as well as a valve.
    """
    steps = np.diff(stem)
    at = np.flatnonzero(np.abs(steps) > _STILL)
    if at.size == 0:
        return 0
    gap = max(5, stem.size // 50)
    direction = np.sign(steps[at])
    return 1 + int(((np.diff(at) > gap) | (np.diff(direction) != 0)).sum())


def judge(score: float, evidence: Evidence, fit: Fit) -> tuple[Verdict, tuple[Reason, ...]]:
    """The verdict and its reasons."""
    figures = (
        f"log Bayes factors {evidence.simulated:.1f} simulated and {evidence.whitened:.1f} "
        f"whitened; simulated PV fits {fit.r2:.3f} against "
        f"{fit.r2_healthy_valve:.3f} with a healthy valve; "
        f"{evidence.strokes} strokes, {evidence.reversals} reversals"
    )
    alone = _alone(evidence)
    if max(fit.r2, fit.r2_healthy_valve) < _MIN_R2 and not alone:
        return Verdict.NOT_ASSESSABLE, (
            Reason(
                ReasonCode.NO_MODEL_EXPLAINS_PV,
                f"no process model explains PV by OP (best fit {fit.r2:.2f} of 1)",
            ),
        )
    both = evidence.simulated >= _EACH[0] and evidence.whitened >= _EACH[1]
    if (both or alone) and score >= _STICTION:
        return Verdict.STICTION, (
            Reason(
                ReasonCode.STICKY_VALVE_EXPLAINS,
                f"PV follows a sticky valve and not a healthy one ({figures})",
            ),
        )
    if evidence.strokes < _MIN_STROKES and fit.r2_healthy_valve < _GOOD_R2:
        return Verdict.NOT_ASSESSABLE, (
            Reason(
                ReasonCode.TOO_FEW_MOVES,
                f"OP travels so little that a valve would move at most once ({figures})",
            ),
        )
    if evidence.simulated >= _EACH[0]:
        return Verdict.NO_STICTION, (
            Reason(
                ReasonCode.DISTURBANCE_EXPLAINS,
                f"a healthy valve and a disturbance from outside explain PV as well as a sticky "
                f"valve ({figures})",
            ),
        )
    return Verdict.NO_STICTION, (
        Reason(
            ReasonCode.HEALTHY_VALVE_SUFFICES,
            f"a healthy valve explains PV as well as a sticky one ({figures})",
        ),
    )
