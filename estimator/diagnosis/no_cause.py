"""What is told where no cause is: the loop is quiet, or why its cause does not show."""

from __future__ import annotations

import math

from estimator.diagnosis.gathered import Gathered
from estimator.diagnosis.result import Cause, CauseName
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.diagnosis.slow_causes import (
    headroom_words,
    is_surely_slow,
    slow_action,
    slow_or_not,
    too_long,
)
from estimator.diagnosis.swing_causes import is_aperiodic, may_be_swung
from estimator.diagnosis.wording import digits
from estimator.outcomes import Reason, ReasonCode

__all__ = ["tell_no_cause", "tell_unproven"]


def tell_no_cause(found: Gathered, settings: DiagnosisSettings) -> Cause:
    """No cause was told: the loop is quiet, or it swings and the record does not show why."""
    swing = found.swing
    if found.still >= settings.judging.by_hand:
        text = (
            f"OP stands still for long in {found.still:.0%} of the record and does not answer the "
            f"control error: a hand holds it, or its moves are too few to show the controller"
        )
        return Cause(
            CauseName.UNDETERMINED, 0.0, (text,), "Record the controller's mode, or record longer."
        )
    # the loop is only known not to make it where the process shows
    shows = found.explained is not None and found.explained.process >= settings.judging.threshold
    shows &= found.is_read(settings)
    if not swing.present or (shows and is_aperiodic(found, settings)):
        return _at_rest(found, settings)
    return _swinging(found, settings, shows=shows)


def _at_rest(found: Gathered, settings: DiagnosisSettings) -> Cause:
    """Nothing oscillates: the loop is quiet, or it may be slow."""
    swing = found.swing
    if not found.has_pv:
        return Cause(CauseName.UNDETERMINED, 0.0, ("OP does not oscillate; PV is not given",),
                     "Give PV and SP of the same hours.")  # fmt: skip
    if found.drawn is not None:
        text = "nothing oscillates; whether the loop is slow or tight does not show"
        why, advice = _hidden(found, found.drawn)
        return Cause(CauseName.UNDETERMINED, 0.0, (text, why), advice)
    if found.controller is None or not (found.controller.integral_rate or found.is_read(settings)):
        # a gain that explains little of OP's moves tells no controller
        text = (
            "nothing oscillates, and OP does not answer the control error: a hand moves it, or "
            "it is not of the controller of this PV"
        )
        return Cause(
            CauseName.UNDETERMINED, 0.0, (text,),
            "Record the controller's mode, and check that OP and PV are of one loop.",
        )  # fmt: skip
    if found.is_read(settings) and may_be_swung(found, settings):
        return _tight_or_swung(found)
    if is_surely_slow(found, settings):
        words = (headroom_words(found, settings),)
        action = slow_action(found, settings)
        return Cause(CauseName.SLOW_TUNING, too_long(settings), words, action)
    slow = found.controller.integral_time_s
    if settings.judging.seen * found.duration_s < slow < math.inf:
        long = f"{digits(slow, 4)} s"
        text = f"nothing oscillates; the integral time ({long}) is too long for the record"
        return Cause(
            CauseName.UNDETERMINED, 0.0, (text,),
            "Give a record of ten integral times and more: it shows whether the loop is slow.",
        )  # fmt: skip
    if found.explained is not None and found.explained.sticking > 0.0:
        # nothing is wrong that shows, but a valve that sticks is likelier than not
        return tell_unproven(found, settings)
    unclear = slow_or_not(found, settings)
    if unclear is not None:
        return unclear
    evidence = ["nothing oscillates, and no cause explains a twentieth of the control error"]
    if swing.present:
        evidence = [
            f"disturbances without a period make what looks like an oscillation of "
            f"{digits(swing.period_s, 4)} s (regularity {digits(swing.regularity, 2)}); no cause "
            f"explains a twentieth of the control error"
        ]
    _, peak = found.amplification()
    one = found.explained
    is_known = one is not None and one.process >= 2.0 * settings.judging.threshold
    if is_known and found.is_read(settings) and peak > settings.judging.tight:
        evidence.append(
            f"by the process that shows, Ms is {digits(peak, 2)} (well-tuned loops 1.4 to 2): with "
            f"more gain it would swing"
        )
    if found.headroom >= settings.judging.likely:
        evidence.append(
            f"{headroom_words(found, settings)}; the error is over within an integral time "
            f"all the same"
        )
    return Cause(CauseName.QUIET, 1.0, tuple(evidence))


def _tight_or_swung(found: Gathered) -> Cause:
    """The loop seems to swing by itself, and a wave from outside is about as likely."""
    assert found.loop is not None
    period_s = found.loop.swing()[0] * found.loop.period
    text = (
        f"the identified loop swings by itself with a period of {digits(period_s, 4)} s, but a "
        f"wave from outside of that period explains PV about as well (log Bayes factor of the wave "
        f"{found.own_wave:.0f}): a tight loop or a wave"
    )
    return Cause(CauseName.UNDETERMINED, 0.0, (text,))


def _hidden(found: Gathered, reason: Reason) -> tuple[str, str]:
    """Why a record shows no more, and what to do; steps of PV look like a historian's lines."""
    sensor = found.sensor
    if reason.code is ReasonCode.RECORD_INTERPOLATED and sensor is not None and sensor.step > 0.0:
        text = (
            f"PV moves in steps of {digits(sensor.step, 2)} standard deviations of the control "
            f"error: what happens between them does not show"
        )
        return text, CauseName.SENSOR.action
    return reason.text, reason.advice


def _swinging(found: Gathered, settings: DiagnosisSettings, *, shows: bool) -> Cause:
    """The loop swings and nothing tells why; ``shows``: whether its process does."""
    swing = found.swing
    if found.explained is not None and found.explained.sticking > settings.judging.unsure:
        return tell_unproven(found, settings)
    evidence = [
        f"there is an oscillation with a period of {digits(swing.period_s, 4)} s "
        f"({swing.cycles:.1f} periods, regularity {digits(swing.regularity, 2)})"
    ]
    action = ""
    if not found.has_pv:
        evidence.append("PV is not given: OP alone does not tell the cause")
        action = "Give PV and SP of the same hours."
    elif found.explained is not None and found.explained.reasons:
        hidden = [_hidden(found, reason) for reason in found.explained.reasons]
        evidence += [text for text, _ in hidden]
        action = hidden[0][1]
    elif found.controller is None:
        evidence.append("OP does not answer the control error: no controller can be read off")
    elif found.has_gap:
        evidence.append(
            f"OP stands still while the error is within {digits(found.gap, 3)}: in such a gap of "
            f"the controller a loop may swing by itself, or be swung from outside"
        )
        action = "Check that the gap is meant; take it out for a few periods and diagnose again."
    elif not found.is_read(settings):
        evidence.append(
            f"the controller's settings as read off explain {found.controller.explained:.0%} of "
            f"OP's moves: too little to tell whether the loop swings by itself"
        )
        action = "Record OP and PV of the same scan, every scan, as the controller has them."
    else:
        evidence.append(_tight_or_outside(found, shows=shows))
    return Cause(CauseName.UNDETERMINED, swing.share, tuple(evidence), action)


def _tight_or_outside(found: Gathered, *, shows: bool) -> str:
    """Why neither is told to make the oscillation; ``shows``: whether the process does."""
    if not shows:
        return (
            "PV hardly follows OP in this record, so whether the loop or the outside makes it does "
            "not show"
        )
    here, _ = found.amplification()
    return (
        f"a tight loop (amplification {digits(here, 2)}) and a wave from outside explain it alike"
    )


def tell_unproven(found: Gathered, settings: DiagnosisSettings) -> Cause:
    """Say that a valve that sticks is likelier than not, and what would show it."""
    one = found.explained
    assert one is not None
    text = (
        f"a sticky valve explains PV better than any other explanation (log Bayes factor "
        f"{one.sticking:.0f}), "
    )
    if one.sticks:
        text += (
            f"but sticking makes only {one.effect:.1%} of PV's variance, and what no model knows "
            f"of a loop may make as much"
        )
    elif one.sticking < settings.judging.threshold:
        text += f"but {settings.judging.threshold:g} are needed"
    else:
        text += "but too few strokes of the record show it"
    if math.isfinite(one.spread):
        text += f" (log Bayes factor without the part that shows it best: {one.spread:.0f})"
    return Cause(
        CauseName.UNDETERMINED,
        found.swing.share if found.swing.present else 0.0,
        (text,),
        "Record longer, or move OP in small steps in manual and see when PV follows.",
    )
