"""From the weighed hypotheses to a verdict with its reasons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.arrays import Array, Index
from estimator.hypotheses.strokes import MOVES
from estimator.outcomes import Reason, ReasonCode, Verdict
from estimator.result import Evidence, Fit
from estimator.settings import Settings

__all__ = ["Judgement", "count_strokes", "describe_stem", "judge", "slips_of"]

_LEAST_EFFECT = 0.01
"""Share of PV's variance that sticking makes, below which it is not called with certainty (tuning
family: one sticky valve of 400 makes less)."""

_LEFT_OUT = 2.0
"""Steps that make a band: a signal stored by exception stands one step behind on its way up and one
on its way down."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """A verdict, whether it is uncertain, and why."""

    verdict: Verdict
    uncertain: bool
    reasons: tuple[Reason, ...]


def slips_of(stem: Array) -> Index:
    """Samples after which a stem ``(n,)`` moves, by more than rounding."""
    return np.flatnonzero(np.abs(np.diff(stem)) > MOVES)


def count_strokes(stem: Array) -> int:
    """Strokes of a stem ``(n,)``: runs of moves in one direction."""
    direction = np.sign(np.diff(stem)[slips_of(stem)])
    return 0 if direction.size == 0 else 1 + int((np.diff(direction) != 0).sum())


def describe_stem(stem: Array) -> tuple[int, int, int]:
    """Moves, reversals and strokes of a stem ``(n,)``."""
    moves = slips_of(stem).size
    strokes = count_strokes(stem)
    return moves, max(0, strokes - 1), strokes


def judge(evidence: Evidence, fit: Fit, settings: Settings) -> Judgement:
    """The verdict: evidence against one threshold, once the window can show a valve at all."""
    judging, screening = settings.judging, settings.screening
    figures = (
        f"log Bayes factor {evidence.log_bayes_factor:.1f}, threshold {judging.threshold:g}; "
        f"PV is explained to {fit.r2:.3f} by a sticky valve and to {fit.r2_healthy_valve:.3f} by a "
        f"healthy one; {evidence.strokes} strokes"
    )

    def answer(
        verdict: Verdict,
        code: ReasonCode,
        text: str,
        doubts: Sequence[str] = (),
    ) -> Judgement:
        reasons = [Reason(code, f"{text} ({figures})")]
        if doubts:
            words = f"{'; '.join(doubts)}: the other verdict is possible"
            reasons.append(Reason(ReasonCode.UNCERTAIN, words))
        return Judgement(verdict, bool(doubts), tuple(reasons))

    sticks = evidence.log_bayes_factor >= judging.threshold
    doubts = []
    if 0.0 < evidence.log_bayes_factor < judging.threshold:
        doubts.append("a sticky valve is likelier than a healthy one, if not by the threshold")
    if sticks and evidence.effect < _LEAST_EFFECT:
        doubts.append(
            f"sticking makes {evidence.effect:.2%} of PV's variance, and what no model knows of a "
            f"loop may make as much"
        )
    if sticks and evidence.over_waves < judging.threshold:
        doubts.append(
            "a load that swings or steps unevenly explains PV about as well as a sticky valve "
            "whose slips vary"
        )
    if evidence.process < judging.process and not sticks:
        return answer(
            Verdict.NOT_ASSESSABLE,
            ReasonCode.NO_MODEL_EXPLAINS_PV,
            f"PV does not follow OP in this window (log-likelihood ratio of any process "
            f"{evidence.process:.1f}, {judging.process:g} is three deviations)",
        )
    gain = 0.5 * evidence.gain_deviations**2
    if evidence.process < judging.threshold and gain < judging.process and not sticks:
        return answer(
            Verdict.NOT_ASSESSABLE,
            ReasonCode.NO_MODEL_EXPLAINS_PV,
            f"PV hardly follows OP in this window: its gain is "
            f"{evidence.gain_deviations:.1f} deviations from zero, three are needed, and no "
            f"process is likelier than none by {judging.threshold:g}",
        )
    if sticks and evidence.strokes < screening.min_strokes:
        return answer(
            Verdict.NOT_ASSESSABLE,
            ReasonCode.TOO_FEW_MOVES,
            f"the stem makes {evidence.strokes} strokes, {screening.min_strokes} are needed",
        )
    strokes, least = judging.few
    if sticks and evidence.strokes < strokes and evidence.log_bayes_factor < least:
        return answer(
            Verdict.NOT_ASSESSABLE,
            ReasonCode.TOO_FEW_MOVES,
            f"the stem makes {evidence.strokes} strokes, which a drifting load may explain: "
            f"{strokes} strokes are needed, or evidence from {least:g} on",
        )
    if sticks and evidence.band_over_span < screening.min_band:
        return answer(
            Verdict.NO_STICTION,
            ReasonCode.BAND_TOO_SMALL,
            f"the stick band is {evidence.band_over_span:.1%} of OP's span, less than a positioner "
            f"resolves",
        )
    if sticks and evidence.band_over_span < _LEFT_OUT * evidence.left_out:
        return answer(
            Verdict.NOT_ASSESSABLE,
            ReasonCode.RECORD_INTERPOLATED,
            f"the stick band is {evidence.band_over_span:.1%} of OP's span, and the historian "
            f"stored a sample only after steps of {evidence.left_out:.1%}, which holds signals "
            f"back as a sticky valve does",
        )
    if sticks and evidence.steady < judging.steady:
        return answer(
            Verdict.NO_STICTION,
            ReasonCode.EVIDENCE_IN_ONE_PART,
            f"a sticky valve is likelier in one part of the window only: without that part the log "
            f"Bayes factor is {evidence.steady:.1f}, and {judging.steady:g} is needed",
            ["the rest of the window holds too little evidence"],
        )
    if sticks:
        return answer(
            Verdict.STICTION,
            ReasonCode.STICKY_VALVE_EXPLAINS,
            "PV follows a sticky valve and not a healthy one",
            doubts,
        )
    outside = evidence.disturbances > 0
    nearly = "nearly " if doubts else ""
    return answer(
        Verdict.NO_STICTION,
        ReasonCode.DISTURBANCE_EXPLAINS if outside else ReasonCode.HEALTHY_VALVE_SUFFICES,
        f"a healthy valve and a disturbance from outside explain PV {nearly}as well as a sticky "
        f"valve"
        if outside
        else f"a healthy valve explains PV {nearly}as well as a sticky one",
        doubts,
    )
