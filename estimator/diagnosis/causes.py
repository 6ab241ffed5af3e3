"""From what was found to causes: each with its weight, the share of what the loop suffers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from estimator.diagnosis.gathered import Gathered
from estimator.diagnosis.no_cause import tell_no_cause, tell_unproven
from estimator.diagnosis.result import Cause, CauseName
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.diagnosis.slow_causes import find_slow
from estimator.diagnosis.swing_causes import (
    VALVE_OR_OUTSIDE,
    find_outside,
    find_tight,
    sticky_weight,
    uneven_wave_words,
)
from estimator.diagnosis.tuning import Advice
from estimator.diagnosis.wording import digits

__all__ = ["rank_causes"]

_INFERRED = 0.9
"""Weight of what is inferred beside what shows itself, at the most, as a share of its weight: slow
tuning beside a sticky valve or a wave from outside, a curved characteristic beside a limit, and of
a sticky valve and an uneven wave that stand for each other the less likely one."""

_SCHEDULE_OVER_PV = (
    "Linearise: schedule the gain over PV or the set-point; until then tune for the range of the "
    "highest gain."
)
"""What helps where the process is curved and not the valve."""


def rank_causes(
    found: Gathered, settings: DiagnosisSettings, proposal: Advice | None = None
) -> tuple[Cause, ...]:
    """The causes, the heaviest first; quiet or undetermined where none is told."""
    facts = _told(
        (_manual(found, settings), _sensor(found, settings), _saturation(found, settings)), settings
    )
    if not facts and _may_stick(found, settings):
        return (tell_unproven(found, settings),)
    sticky, outside = _sticky(found, settings), find_outside(found, settings)
    if sticky is not None and outside is not None and found.doubts_valve(settings):
        # they explain the same motion, and the less likely one comes second
        assert found.explained is not None
        if found.explained.over_waves < 0.0:
            sticky = replace(sticky, weight=_INFERRED * sticky.weight)
        else:
            outside = replace(outside, weight=_INFERRED * outside.weight)
    slow = find_slow(found, settings, proposal)
    for shown in (sticky, outside):
        if shown is not None and shown.weight >= settings.judging.told and slow is not None:
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
    return (tell_no_cause(found, settings),)


def _told(tried: Iterable[Cause | None], settings: DiagnosisSettings) -> list[Cause]:
    least = settings.judging.told
    return [one for one in tried if one is not None and one.weight >= least]


def _manual(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    if found.manual < settings.judging.by_hand:
        return None
    text = f"the controller is in manual for {found.manual:.0%} of the record"
    if not found.has_mode:
        text = (
            f"OP does not answer the control error for {found.manual:.0%} of the record, as in "
            f"manual; the mode was not recorded"
        )
    return Cause(CauseName.MANUAL, 0.5 + 0.5 * found.manual, (text,))


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
            f"PV moves in steps of {digits(sensor.step, 2)} standard deviations of the control "
            f"error"
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
            f"{digits(100.0 * sensor.shaken, 2)} % from sample to sample"
        )
    return Cause(CauseName.SENSOR, weight, tuple(evidence)) if evidence else None


def _saturation(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    limits = found.limits
    if limits.share < settings.facts.least_limit:
        return None
    sides = [side for side, held in (("highest", limits.high), ("lowest", limits.low)) if held]
    value = "" if len(sides) > 1 else f" ({digits(limits.value, 4)})"
    return Cause(
        CauseName.SATURATION,
        max(limits.cost, 0.5 * limits.share),
        (
            f"OP stands at its {' or '.join(sides)} value{value} for {limits.share:.0%} of the "
            f"record while the error asks for more; {limits.cost:.0%} of the squared error falls "
            f"into that time",
        ),
    )


def _sticky(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    one = found.explained
    if one is None or not found.is_sticky:
        return None
    is_doubted = found.doubts_valve(settings)
    than = "a healthy one" if is_doubted else "any other explanation"
    evidence = [
        f"a sticky valve explains PV better than {than}: log Bayes factor "
        f"{one.sticking:.0f}, {one.spread:.0f} without the part of the record that shows it "
        f"best",
    ]
    if is_doubted:
        evidence.append(uneven_wave_words(found, settings))
    evidence.append(
        f"stick band about {digits(one.band, 3)}, slip jump about {digits(one.jump, 3)} in "
        f"units of OP"
    )
    action = VALVE_OR_OUTSIDE if is_doubted else ""
    return Cause(CauseName.STICKY_VALVE, sticky_weight(found), tuple(evidence), action)


def _may_stick(found: Gathered, settings: DiagnosisSettings) -> bool:
    """Whether a sticky valve is the likeliest explanation, and too little for a verdict."""
    one, judging = found.explained, settings.judging
    if one is None or one.sticks:
        return False
    return one.sticking >= judging.threshold and one.spread >= judging.unsure


def _times(ratio: float) -> str:
    return "more than a thousand times" if ratio > 1000.0 else f"{digits(ratio, 2)} times"


def _characteristic(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    one, judging = found.explained, settings.judging
    if one is None or one.curved < judging.threshold or found.is_sticky:
        return None
    curvature, is_process = found.curvature, one.process > 2.0 * judging.threshold
    if curvature is None or not is_process or curvature.ratio < judging.ratio:
        return None
    return Cause(
        CauseName.CHARACTERISTIC,
        (1.0 - 1.0 / curvature.ratio) * (1.0 - found.limits.cost),
        (
            f"the gain from OP to PV changes {_times(curvature.ratio)} over {curvature.over}'s "
            f"middle nine tenths and is {curvature.where}: log Bayes factor {one.curved:.0f} over "
            f"a gain that does not change",
        ),
        _SCHEDULE_OVER_PV if curvature.over == "PV" else "",
    )
