"""Whether a loop's tuning is slow, shown or not."""

from __future__ import annotations

import math

import numpy as np

from estimator.diagnosis.gathered import Gathered, error_lasts
from estimator.diagnosis.result import Cause, CauseName
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.diagnosis.swing_causes import find_outside, find_tight, may_be_swung
from estimator.diagnosis.tuning import Advice
from estimator.diagnosis.wording import digits

__all__ = [
    "find_slow",
    "headroom_words",
    "is_surely_slow",
    "slow_action",
    "slow_or_not",
    "too_long",
]

_STEP_FIRST = (
    "Step the set-point once and diagnose again before it is retuned: a load that goes on ramping "
    "makes the same error."
)
"""What comes first where PV hardly follows OP, so that only the error tells a slow tuning."""


def find_slow(
    found: Gathered, settings: DiagnosisSettings, proposal: Advice | None
) -> Cause | None:
    """Return slow tuning as a cause, where the record shows it."""
    judging, controller = settings.judging, found.controller
    if controller is None or find_tight(found, settings) is not None:
        return None
    if found.drawn is not None or found.has_gap:
        # how long the error lasts is not that of the loop: a historian drew it, or a gap leaves it
        return None
    outside = find_outside(found, settings)
    unexplained = found.swing.present and outside is None and not found.is_sticky
    rings = unexplained and found.amplification()[0] > judging.tight
    if rings or may_be_swung(found, settings):
        # a loop that may swing by itself is not slow
        return None
    one, two = found.predictable
    removable = found.removable_where_known(settings)
    if math.isnan(one):
        # a record of few integral times: only the process tells
        is_long = controller.integral_time_s > judging.seen * found.duration_s
        if not (is_long and removable > judging.lasting):
            return None
        evidence = [f"the integral time is {digits(controller.integral_time_s, 4)} s"]
        weight = removable
    elif _lingers(found, settings):
        further = "" if math.isnan(two) else f", {two:.0%} two ahead"
        evidence = [
            f"{one:.0%} of the control error can be predicted one integral time "
            f"({digits(controller.integral_time_s, 3)} s) ahead{further}; a loop that "
            f"settles within its integral time has no such error, unless its load goes on changing",
        ]
        weight = min(1.0, max(one, two))
    elif outside is not None and is_surely_slow(found, settings):
        # beside what is known to come from outside the loop is slow or well tuned
        evidence = []
        weight = too_long(settings)
    else:
        return None
    if found.headroom >= judging.likely:
        evidence.append(headroom_words(found, settings))
    if proposal is not None and proposal.integral_ratio > settings.headroom.slower:
        evidence.append(
            f"as robust settings have {digits(proposal.integral_ratio, 2)} times the integral gain"
        )
    if removable >= judging.removable:
        evidence.append(f"robust settings would remove {removable:.0%} of the squared error")
    shared = found.limits.cost + (found.swing_share if found.swing.present else 0.0)
    weight *= max(0.0, 1.0 - shared)
    return Cause(CauseName.SLOW_TUNING, weight, tuple(evidence), slow_action(found, settings))


def slow_action(found: Gathered, settings: DiagnosisSettings) -> str:
    """What to do about a slow tuning."""
    usual = CauseName.SLOW_TUNING.action
    is_shown = not math.isnan(found.removable_where_known(settings))
    return usual if is_shown else f"{_STEP_FIRST} {usual}"


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
        # the error says slow, the processes and loads that fit say it is not: surely or not
        return None if found.headroom > 1.0 - judging.surely else False
    # against an error that lasts so long it takes both, the process and the headroom
    little = found.removable_where_known(settings) < judging.removable
    return not (little and not found.headroom >= judging.likely)


def is_surely_slow(found: Gathered, settings: DiagnosisSettings) -> bool:
    """Whether headroom alone tells it: the integral time is too long for the error to last.

    It is that beside a controller as read: one that explains little of OP's moves (a gap, a gain
    that grows with the error) is another one.
    """
    little = found.removable_where_known(settings) <= settings.judging.lasting
    one, unsure = found.explained, settings.judging.unsure
    # the room for gain is that of a healthy valve
    if little or found.has_gap or (one is not None and one.sticking >= unsure):
        return False
    if not found.is_read(settings):
        return False
    return found.headroom >= settings.judging.surely


def too_long(settings: DiagnosisSettings) -> float:
    """Share of an answer's time: with so much more integral gain it is over as much sooner."""
    return 1.0 - 1.0 / settings.headroom.slower


def headroom_words(found: Gathered, settings: DiagnosisSettings) -> str:
    """Say how likely robust settings have more integral gain."""
    return (
        f"with a probability of {found.headroom:.0%} robust settings have "
        f"{settings.headroom.slower:g} times the integral gain and more"
    )


def slow_or_not(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    """What is told where the record shows neither a slow tuning nor a well-tuned loop."""
    judging = settings.judging
    evidence: tuple[str, ...]
    may_be_slow = found.headroom > judging.unlikely or error_lasts(found.predictable, settings)
    if found.has_gap and may_be_slow:
        evidence = (
            f"nothing oscillates; OP stands still while the error is within "
            f"{digits(found.gap, 3)}: "
            f"a gap of the controller leaves it, and the record does not show how fast the loop is",
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
            headroom_words(found, settings),
        )
    else:
        return None
    return Cause(
        CauseName.UNDETERMINED,
        0.0,
        evidence,
        "Step the set-point once: the answer shows whether the loop is slow.",
    )
