"""From evidence to a verdict."""

from __future__ import annotations

import math

import numpy as np

from estimator._kernels import Array
from estimator.outcomes import Reason, ReasonCode, Verdict
from estimator.result import Evidence, Fit

__all__ = ["evidence_of", "judge", "strokes_of"]

_STICTION = 3.0
"""A Bayes factor of e^3 = 20: strong evidence by the usual scales (Kass and Raftery, 1995)."""

_MIN_R2 = 0.3
_GOOD_R2 = 0.9
_MIN_STROKES = 2
_VALVE_PARAMETERS = 3
_STILL = 1e-9


def evidence_of(
    stem: Array, healthy_cost: float, sticky_cost: float, samples: float, band: float
) -> tuple[float, Evidence]:
    """Score and evidence; ``stem`` and ``band`` are in shares of OP's span.

    The score is the logarithm of the Bayes factor of a sticky over a healthy valve in BIC's
    approximation: the log-likelihood ratio less ``3/2 log n`` for S, J and the first position, with
    ``n`` effective samples; zero where that is negative or where the stem makes a single stroke.
    """
    ratio = 0.5 * samples * math.log(max(healthy_cost, sticky_cost) / sticky_cost)
    steps = np.diff(stem)
    moved = steps[np.abs(steps) > _STILL]
    reversals = int((np.sign(moved[1:]) != np.sign(moved[:-1])).sum())
    strokes = strokes_of(stem)
    evidence = Evidence(ratio, samples, int(moved.size), reversals, strokes, band)
    score = max(0.0, ratio - 0.5 * _VALVE_PARAMETERS * math.log(samples))
    return (score if strokes >= _MIN_STROKES else 0.0), evidence


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
        f"log Bayes factor {score:.1f}; simulated PV fits {fit.r2:.3f} against "
        f"{fit.r2_healthy_valve:.3f} with a healthy valve; "
        f"{evidence.strokes} strokes, {evidence.reversals} reversals"
    )
    if max(fit.r2, fit.r2_healthy_valve) < _MIN_R2:
        return Verdict.NOT_ASSESSABLE, (
            Reason(
                ReasonCode.NO_MODEL_EXPLAINS_PV,
                f"no process model explains PV by OP (best fit {fit.r2:.2f} of 1)",
            ),
        )
    if score >= _STICTION:
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
    return Verdict.NO_STICTION, (
        Reason(
            ReasonCode.HEALTHY_VALVE_SUFFICES,
            f"a healthy valve explains PV as well as a sticky one ({figures})",
        ),
    )
