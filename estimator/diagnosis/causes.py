"""From what was found to causes: each with its weight, the share of what the loop suffers."""

from __future__ import annotations

import math

from estimator.diagnosis.gathered import Gathered
from estimator.diagnosis.result import Cause, CauseName
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.diagnosis.tuning import Advice

__all__ = ["rank_causes"]


def rank_causes(
    found: Gathered, settings: DiagnosisSettings, proposal: Advice | None = None
) -> tuple[Cause, ...]:
    """The causes, the heaviest first; quiet or undetermined where none is told."""
    tried = (
        _manual(found, settings),
        _sensor(found, settings),
        _saturation(found, settings),
        _sticky(found),
        _tight(found, settings),
        _outside(found, settings),
        _characteristic(found, settings),
        _slow(found, settings, proposal),
    )
    causes = [one for one in tried if one is not None and one.weight >= settings.judging.told]
    causes.sort(key=lambda one: -one.weight)
    if causes:
        return tuple(causes)
    return (_none(found, settings),)


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
    if sensor.spike_cost > judging.spikes:
        weight = max(weight, sensor.spike_cost)
        evidence.append(
            f"{sensor.spikes:.2%} of the samples are spikes; they hold {sensor.spike_cost:.0%} of "
            f"the squared error"
        )
    if sensor.noise_share > judging.noisy and sensor.shaken > judging.shaken:
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
    side = "highest" if limits.high else "lowest"
    return Cause(
        CauseName.SATURATION,
        max(limits.cost, 0.5 * limits.share),
        (
            f"OP stands at its {side} value ({limits.value:.4g}) for {limits.share:.0%} of the "
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
        _stuck_weight(found),
        (
            f"a sticky valve explains PV better than any other explanation: log Bayes factor "
            f"{one.sticking:.0f}, {one.spread:.0f} without the quarter of the record that shows it "
            f"best",
            f"stick band about {one.band:.3g}, slip jump about {one.jump:.3g} in units of OP",
        ),
    )


def _stuck_weight(found: Gathered) -> float:
    assert found.explained is not None
    swings = found.swing.share if found.swing.present else 0.0
    return min(1.0, max(found.explained.effect, swings, 0.3))


def _rings(found: Gathered, settings: DiagnosisSettings) -> bool:
    """Whether the loop's own resonance makes the oscillation."""
    if found.loop is None or found.explained is None or not found.swing.present:
        return False
    judging = settings.judging
    here, _ = found.amplification()
    beside = found.amplification_beside_wave()
    if here <= judging.tight or beside <= judging.well:
        return False
    if found.explained.outside >= -judging.unsure:
        return False
    # a swing that dies out more slowly than the record is long looks like a wave from outside
    _, damping = found.loop.swing()
    dies = 2.0 * math.pi * max(damping, 0.0) * found.swing.cycles
    at_limit = found.limits.share > settings.facts.least_limit
    return dies > judging.dies or at_limit or beside > judging.endless


def _tight(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    one, judging = found.explained, settings.judging
    if one is None or found.loop is None or found.is_sticky:
        return None
    here, peak = found.amplification()
    period, damping = found.loop.swing()
    if found.swing.present:
        if not _rings(found, settings):
            return None
        weight = found.swing.share * max(0.0, 1.0 - (judging.well / here) ** 2)
        evidence = (
            f"the loop itself amplifies disturbances {here:.3g} times at the period of the "
            f"oscillation (well-tuned loops 1.4 to 2), and no wave from outside is needed (log "
            f"Bayes factor {one.outside:.0f})",
        )
    elif (
        damping < judging.damping
        and peak > 2.0 * judging.tight
        and one.process > 2.0 * judging.threshold
        and 4.0 < period < 0.05 * found.samples
    ):
        weight = max(0.0, 1.0 - (judging.well / peak) ** 2) * 0.5
        evidence = (
            f"the closed loop swings with a period of {period * found.loop.period:.3g} s at a "
            f"damping ratio of {damping:.2f}; Ms is {peak:.3g} (well-tuned loops 1.4 to 2)",
        )
    else:
        return None
    margins = found.loop.margins()
    figures = f"gain margin {margins.gain:.2f}, phase margin {margins.phase_deg:.0f} degrees"
    return Cause(CauseName.TIGHT_TUNING, min(1.0, weight), (*evidence, figures))


def _outside(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    one, swing = found.explained, found.swing
    if one is not None and one.wave is not None:
        # the valve's own cycle comes before it: the wave alone would leave the valve unexplained
        return Cause(
            CauseName.EXTERNAL_OSCILLATION,
            min(found.wave_share, 0.99 * _stuck_weight(found)),
            (
                f"beside the sticky valve there is a wave of {one.wave.period_s:.4g} s from "
                f"outside: log Bayes factor {one.wave.evidence:.0f}",
            ),
        )
    if not swing.present or not found.has_pv or found.is_sticky:
        return None
    if found.setpoint_swings:
        return Cause(
            CauseName.EXTERNAL_OSCILLATION,
            swing.share,
            (f"the set-point itself oscillates with a period of {swing.period_s:.4g} s",),
        )
    if one is None or one.model is None:
        return None
    here, _ = found.amplification()
    beside = found.amplification_beside_wave()
    unsure = settings.judging.unsure
    # a process that is fitted to a steady wave takes it for its own resonance
    is_swung = here > settings.judging.tight and beside <= settings.judging.well
    if not is_swung:
        if one.outside < unsure and (here > settings.judging.tight or found.loop is None):
            return None
        if one.outside < -unsure:
            # the loop and smooth noise explain the hump: nothing steady is outside
            return None
    evidence = [
        f"a wave of {swing.period_s:.4g} s from outside explains PV better than the loop alone: "
        f"log Bayes factor {one.outside:.0f}"
        if one.outside > 0.0
        else "neither valve nor tuning makes this oscillation",
    ]
    if is_swung:
        evidence.append(
            f"by what the record shows beside the oscillation the loop amplifies disturbances of "
            f"this period only {beside:.2g} times"
        )
    elif math.isfinite(here):
        evidence.append(f"the loop amplifies disturbances of this period only {here:.2g} times")
    return Cause(CauseName.EXTERNAL_OSCILLATION, swing.share, tuple(evidence))


def _characteristic(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    one, judging = found.explained, settings.judging
    if one is None or one.curved < judging.threshold or found.is_sticky:
        return None
    ratio = math.exp(min(50.0, abs(one.bend) * found.op_middle))
    is_process = one.process > 2.0 * judging.threshold
    if not (is_process and judging.ratio <= ratio <= judging.most_ratio):
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


def _slow(found: Gathered, settings: DiagnosisSettings, proposal: Advice | None) -> Cause | None:
    judging = settings.judging
    one, two = found.predictable
    if found.swing.present or not two > judging.slow or found.controller is None:
        return None
    evidence = [
        f"{one:.0%} of the control error could be told an integral time "
        f"({found.controller.integral_time_s:.3g} s) before, {two:.0%} two: a loop that settles "
        f"within its integral time would not have it",
    ]
    if proposal is not None and proposal.integral_ratio > judging.slower:
        evidence.append(
            f"as robust settings have {proposal.integral_ratio:.2g} times the integral gain"
        )
    weight = min(1.0, max(one, two)) * (1.0 - found.limits.cost)
    return Cause(CauseName.SLOW_TUNING, weight, tuple(evidence))


def _none(found: Gathered, settings: DiagnosisSettings) -> Cause:
    """No cause was told: the loop is quiet, or it swings and the record does not show why."""
    swing = found.swing
    if not swing.present:
        if not found.has_pv:
            return Cause(CauseName.UNDETERMINED, 0.0, ("OP does not oscillate; PV is not given",),
                         "Give PV and SP of the same hours.")  # fmt: skip
        slow = 0.0 if found.controller is None else found.controller.integral_time_s
        if settings.judging.seen * found.duration_s < slow < math.inf:
            text = (
                f"nothing oscillates; the integral time ({slow:.4g} s) is too long for the record"
            )
            return Cause(
                CauseName.UNDETERMINED, 0.0, (text,),
                "Give a record of ten integral times and more: it shows whether the loop is slow.",
            )  # fmt: skip
        return Cause(
            CauseName.QUIET,
            1.0,
            ("nothing oscillates, and no cause explains a twentieth of the control error",),
        )
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
    else:
        here, _ = found.amplification()
        evidence.append(
            f"a tight loop (amplification {here:.2g}) and a wave from outside explain it alike"
        )
    return Cause(CauseName.UNDETERMINED, swing.share, tuple(evidence), action)
