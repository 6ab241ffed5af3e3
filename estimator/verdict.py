"""From evidence to a verdict."""

from __future__ import annotations

from estimator.outcomes import Reason, ReasonCode, Verdict
from estimator.result import Evidence, Fit

__all__ = ["judge"]

_SCORE_STICTION = 4.0
_MIN_R2 = 0.3


def judge(score: float, evidence: Evidence, fit: Fit) -> tuple[Verdict, tuple[Reason, ...]]:
    """The verdict and its reasons."""
    figures = (
        f"log-likelihood ratio {evidence.log_likelihood_ratio:.1f}, "
        f"fit {fit.r2:.3f} against {fit.r2_healthy_valve:.3f} with a healthy valve, "
        f"{evidence.moves} moves and {evidence.reversals} reversals"
    )
    if max(fit.r2, fit.r2_healthy_valve) < _MIN_R2:
        return Verdict.NOT_ASSESSABLE, (
            Reason(
                ReasonCode.NO_MODEL_EXPLAINS_PV,
                f"no process model explains PV by OP (best fit {fit.r2:.2f})",
            ),
        )
    if score >= _SCORE_STICTION:
        return Verdict.STICTION, (
            Reason(
                ReasonCode.STICKY_VALVE_EXPLAINS,
                f"PV follows a sticky valve better than a healthy one: {figures}",
            ),
        )
    return Verdict.NO_STICTION, (
        Reason(
            ReasonCode.HEALTHY_VALVE_SUFFICES,
            f"a healthy valve explains PV as well as a sticky one: {figures}",
        ),
    )
