"""From what was found to causes: each with its weight, the share of what the loop suffers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from estimator.diagnosis.gathered import Gathered, error_lasts
from estimator.diagnosis.result import Cause, CauseName
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.diagnosis.swing_causes import find_outside, find_tight, is_aperiodic, sticky_weight
from estimator.diagnosis.tuning import Advice

__all__ = ["rank_causes"]

_INFERRED = 0.9
"""Weight of what is inferred beside what shows itself, at the most, as a share of its weight: slow
tuning beside a sticky valve or a wave from outside, a curved characteristic beside a limit."""


def rank_causes(
    found: Gathered, settings: DiagnosisSettings, proposal: Advice | None = None
) -> tuple[Cause, ...]:
    """The causes, the heaviest first; quiet or undetermined where none is told."""
    facts = _told(
        (_manual(found, settings), _sensor(found, settings), _saturation(found, settings)), settings
    )
    if not facts and _may_stick(found, settings):
        return (_unproven(found, settings),)
    sticky, outside = _sticky(found), find_outside(found, settings)
    slow = _slow(found, settings, proposal)
    for shown in (sticky, outside):
        if shown is not None and slow is not None:
            # slow tuning is inferred from what these leave of the error
            slow = replace(slow, weight=min(slow.weight, _INFERRED * shown.weight))
    curved, limit = _characteristic(found, settings), _saturation(found, settings)
    if curved is not None and limit is not None:
        # a valve at its limit bends the characteristic that is fitted
        curved = replace(curved, weight=min(curved.weight, _INFERRED * limit.weight))
    causes = facts + _told(
        (
            sticky,
            find_tight(found, settings),
            outside,
            curved,
            slow,
        ),
        settings,
    )
    causes.sort(key=lambda one: -one.weight)
    if causes:
        return tuple(causes)
    return (_none(found, settings),)


def _told(tried: Iterable[Cause | None], settings: DiagnosisSettings) -> list[Cause]:
    least = settings.judging.told
    return [one for one in tried if one is not None and one.weight >= least]


def _manual(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    if found.manual < settings.judging.by_hand:
        return None
    return Cause(
        CauseName.MANUAL,
        0.5 + 0.5 * found.manual,
        (f"the controller is in manual for {found.manual:.0%} of the record",),
    )


def _sensor(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    sensor, judging = found.sensor, settings.judging
    if sensor is None:
        return None
    evidence, weight = [], 0.0
    if sensor.frozen > judging.frozen:
        weight = max(weight, 0.5 + 0.5 * sensor.frozen)
        evidence.append(f"PV stands still for {sensor.frozen:.0%} of the record")
    if sensor.step > judging.step:
        weight = max(weight, min(1.0, 0.5 * sensor.step))
        evidence.append(
            f"PV moves in steps of {sensor.step:.2g} standard deviations of the control error"
        )
    if sensor.spike_cost >= judging.told:
        weight = max(weight, sensor.spike_cost)
        evidence.append(
            f"{sensor.spikes:.2%} of the samples are spikes; they hold {sensor.spike_cost:.0%} of "
            f"the squared error"
        )
    is_noisy = sensor.noise_share > judging.noisy and sensor.shaken > judging.shaken
    if found.swing.present:
        # most of what the oscillation leaves, also with the gain of a loop that does not swing
        left = judging.noisy * (1.0 - found.swing_share)
        is_noisy |= sensor.noise_share > left and sensor.shaken > judging.swung * judging.shaken
    if is_noisy:
        weight = max(weight, sensor.noise_share)
        evidence.append(
            f"noise is {sensor.noise_share:.0%} of the error's variance and moves OP by "
            f"{100.0 * sensor.shaken:.2g} % from sample to sample"
        )
    return Cause(CauseName.SENSOR, weight, tuple(evidence)) if evidence else None


def _saturation(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    limits = found.limits
    if limits.share < settings.facts.least_limit:
        return None
    sides = [side for side, held in (("highest", limits.high), ("lowest", limits.low)) if held]
    value = "" if len(sides) > 1 else f" ({limits.value:.4g})"
    return Cause(
        CauseName.SATURATION,
        max(limits.cost, 0.5 * limits.share),
        (
            f"OP stands at its {' or '.join(sides)} value{value} for {limits.share:.0%} of the "
            f"record while the error asks for more; {limits.cost:.0%} of the squared error falls "
            f"into that time",
        ),
    )


def _sticky(found: Gathered) -> Cause | None:
    one = found.explained
    if one is None or not found.is_sticky:
        return None
    return Cause(
        CauseName.STICKY_VALVE,
        sticky_weight(found),
        (
            f"a sticky valve explains PV better than any other explanation: log Bayes factor "
            f"{one.sticking:.0f}, {one.spread:.0f} without the part of the record that shows it "
            f"best",
            f"stick band about {one.band:.3g}, slip jump about {one.jump:.3g} in units of OP",
        ),
    )


def _may_stick(found: Gathered, settings: DiagnosisSettings) -> bool:
    """Whether a sticky valve is the likeliest explanation, and too little for a verdict."""
    one, judging = found.explained, settings.judging
    if one is None or one.sticks:
        return False
    return one.sticking >= judging.threshold and one.spread >= judging.unsure


def _unproven(found: Gathered, settings: DiagnosisSettings) -> Cause:
    one = found.explained
    assert one is not None
    text = (
        f"a sticky valve explains PV better than any other explanation (log Bayes factor "
        f"{one.sticking:.0f}), "
    )
    if one.sticking < settings.judging.threshold:
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


def _characteristic(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    one, judging = found.explained, settings.judging
    if one is None or one.curved < judging.threshold or found.is_sticky:
        return None
    ratio = math.exp(min(50.0, abs(one.bend) * found.op_middle))
    is_process = one.process > 2.0 * judging.threshold
    if not is_process or ratio < judging.ratio:
        return None
    return Cause(
        CauseName.CHARACTERISTIC,
        (1.0 - 1.0 / ratio) * (1.0 - found.limits.cost),
        (
            f"the gain from OP to PV changes {ratio:.2g} times over OP's middle nine tenths and is "
            f"{'higher' if one.bend > 0.0 else 'lower'} at high OP: log Bayes factor "
            f"{one.curved:.0f} over a straight characteristic",
        ),
    )


def _lingers(found: Gathered, settings: DiagnosisSettings) -> bool | None:
    """Whether the error lasts because the tuning is slow; None where smooth loads may make it."""
    judging = settings.judging
    one, two = np.nan_to_num(found.predictable)
    if not error_lasts(found.predictable, settings):
        return False
    if one + two < judging.lasts:
        if found.removable_where_known(settings) < judging.removable:
            return False
        if found.headroom < judging.likely:
            return None if found.headroom > judging.unlikely else False
        return True
    if found.headroom <= judging.unlikely:
        # the error says slow, the processes and loads that fit say it is not
        return None
    # against an error that lasts so long it takes both, the process and the headroom
    little = found.removable_where_known(settings) < judging.removable
    return not (little and not found.headroom >= judging.likely)


def _slow(found: Gathered, settings: DiagnosisSettings, proposal: Advice | None) -> Cause | None:
    judging, controller = settings.judging, found.controller
    if controller is None or (found.swing.present and find_tight(found, settings) is not None):
        return None
    if found.drawn is not None or found.has_gap:
        # how long the error lasts is not that of the loop: a historian drew it, or a gap leaves it
        return None
    one, two = found.predictable
    removable = found.removable_where_known(settings)
    if math.isnan(one):
        # a record of few integral times: only the process tells
        is_long = controller.integral_time_s > judging.seen * found.duration_s
        if not (is_long and removable > judging.lasting):
            return None
        evidence = [f"the integral time is {controller.integral_time_s:.4g} s"]
        weight = removable
    elif _lingers(found, settings):
        further = "" if math.isnan(two) else f", {two:.0%} two ahead"
        evidence = [
            f"{one:.0%} of the control error can be predicted one integral time "
            f"({controller.integral_time_s:.3g} s) ahead{further}; a loop that "
            f"settles within its integral time has no such error",
        ]
        weight = min(1.0, max(one, two))
    elif find_outside(found, settings) is not None and _is_surely_slow(found, settings):
        # beside what is known to come from outside the loop is slow or well tuned
        evidence = []
        weight = _too_long(settings)
    else:
        return None
    if found.headroom >= judging.likely:
        evidence.append(_headroom_words(found, settings))
    if proposal is not None and proposal.integral_ratio > settings.headroom.slower:
        evidence.append(
            f"as robust settings have {proposal.integral_ratio:.2g} times the integral gain"
        )
    if removable >= judging.removable:
        evidence.append(f"robust settings would remove {removable:.0%} of the squared error")
    shared = found.limits.cost + (found.swing_share if found.swing.present else 0.0)
    return Cause(CauseName.SLOW_TUNING, weight * max(0.0, 1.0 - shared), tuple(evidence))


def _is_surely_slow(found: Gathered, settings: DiagnosisSettings) -> bool:
    """Whether headroom alone tells it: the integral time is too long for the error to last.

    It is that beside a controller as read: one that explains little of OP's moves (a gap, a gain
    that grows with the error) is another one.
    """
    little = found.removable_where_known(settings) <= settings.judging.lasting
    one, unsure = found.explained, settings.judging.unsure
    # the room for gain is that of a healthy valve
    if little or found.has_gap or (one is not None and one.sticking >= unsure):
        return False
    if not _is_read(found, settings):
        return False
    return found.headroom >= settings.judging.surely


def _too_long(settings: DiagnosisSettings) -> float:
    """Share of an answer's time: with so much more integral gain it is over as much sooner."""
    return 1.0 - 1.0 / settings.headroom.slower


def _headroom_words(found: Gathered, settings: DiagnosisSettings) -> str:
    return (
        f"with a probability of {found.headroom:.0%} robust settings have "
        f"{settings.headroom.slower:g} times the integral gain and more"
    )


def _slow_or_not(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    """What is told where the record shows neither a slow tuning nor a well-tuned loop."""
    judging = settings.judging
    evidence: tuple[str, ...]
    may_be_slow = found.headroom > judging.unlikely or error_lasts(found.predictable, settings)
    if found.has_gap and may_be_slow:
        evidence = (
            f"nothing oscillates; OP stands still while the error is within {found.gap:.3g}: a gap "
            f"of the controller leaves it, and the record does not show how fast the loop is",
        )
        return Cause(
            CauseName.UNDETERMINED, 0.0, evidence,
            "Check that the gap is meant; step the set-point by some times as much, and diagnose "
            "again.",
        )  # fmt: skip
    if _lingers(found, settings) is None:
        one, _ = found.predictable
        evidence = (
            f"nothing oscillates; {one:.0%} of the control error can be predicted one integral "
            f"time ahead: by a slow tuning (probability {found.headroom:.0%}) or a smooth load",
        )
    elif found.headroom >= judging.probable:
        evidence = (
            "nothing oscillates, and the record does not show that the control error lasts",
            _headroom_words(found, settings),
        )
    else:
        return None
    return Cause(
        CauseName.UNDETERMINED,
        0.0,
        evidence,
        "Step the set-point once: the answer shows whether the loop is slow.",
    )


def _is_read(found: Gathered, settings: DiagnosisSettings) -> bool:
    """Whether the controller is known well enough to close the loop with."""
    one = found.controller
    return one is not None and (one.timed or one.explained >= settings.judging.explains)


def _none(found: Gathered, settings: DiagnosisSettings) -> Cause:
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
    shows &= _is_read(found, settings)
    if not swing.present or (shows and is_aperiodic(found, settings)):
        if not found.has_pv:
            return Cause(CauseName.UNDETERMINED, 0.0, ("OP does not oscillate; PV is not given",),
                         "Give PV and SP of the same hours.")  # fmt: skip
        if found.drawn is not None:
            text = "nothing oscillates; whether the loop is slow or tight does not show"
            return Cause(CauseName.UNDETERMINED, 0.0, (text, found.drawn.text), found.drawn.advice)
        if found.controller is None or not (
            found.controller.integral_rate or _is_read(found, settings)
        ):
            # a gain that explains little of OP's moves tells no controller
            text = (
                "nothing oscillates, and OP does not answer the control error: a hand moves it, or "
                "it is not of the controller of this PV"
            )
            return Cause(
                CauseName.UNDETERMINED, 0.0, (text,),
                "Record the controller's mode, and check that OP and PV are of one loop.",
            )  # fmt: skip
        if _is_surely_slow(found, settings):
            words = (_headroom_words(found, settings),)
            return Cause(CauseName.SLOW_TUNING, _too_long(settings), words)
        slow = found.controller.integral_time_s
        if settings.judging.seen * found.duration_s < slow < math.inf:
            text = (
                f"nothing oscillates; the integral time ({slow:.4g} s) is too long for the record"
            )
            return Cause(
                CauseName.UNDETERMINED, 0.0, (text,),
                "Give a record of ten integral times and more: it shows whether the loop is slow.",
            )  # fmt: skip
        if found.explained is not None and found.explained.sticking > 0.0:
            # nothing is wrong that shows, but a valve that sticks is likelier than not
            return _unproven(found, settings)
        unclear = _slow_or_not(found, settings)
        if unclear is not None:
            return unclear
        evidence = ["nothing oscillates, and no cause explains a twentieth of the control error"]
        if swing.present:
            evidence = [
                f"disturbances without a period make what looks like an oscillation of "
                f"{swing.period_s:.4g} s (regularity {swing.regularity:.2g}); no cause explains a "
                f"twentieth of the control error"
            ]
        return Cause(CauseName.QUIET, 1.0, tuple(evidence))
    if found.explained is not None and found.explained.sticking > settings.judging.unsure:
        return _unproven(found, settings)
    evidence = [
        f"there is an oscillation with a period of {swing.period_s:.4g} s "
        f"({swing.cycles:.1f} periods, regularity {swing.regularity:.2g})"
    ]
    action = ""
    if not found.has_pv:
        evidence.append("PV is not given: OP alone does not tell the cause")
        action = "Give PV and SP of the same hours."
    elif found.explained is not None and found.explained.reasons:
        evidence += [reason.text for reason in found.explained.reasons]
        action = found.explained.reasons[0].advice
    elif found.controller is None:
        evidence.append("OP does not answer the control error: no controller can be read off")
    elif not _is_read(found, settings):
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
    return f"a tight loop (amplification {here:.2g}) and a wave from outside explain it alike"
