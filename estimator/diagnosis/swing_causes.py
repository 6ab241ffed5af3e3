"""What makes a loop swing: its own tuning, a wave from outside, or nothing that has a period."""

from __future__ import annotations

import math

from estimator.diagnosis.gathered import Gathered
from estimator.diagnosis.oscillation import has_steady_period
from estimator.diagnosis.result import Cause, CauseName
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.diagnosis.wording import digits

__all__ = [
    "VALVE_OR_OUTSIDE",
    "find_outside",
    "find_tight",
    "is_aperiodic",
    "may_be_swung",
    "sticky_weight",
    "uneven_wave_words",
]

VALVE_OR_OUTSIDE = (
    "Before the valve is opened, put the loop in manual for a few periods: an oscillation that "
    "goes on comes from outside, one that ends is the valve's."
)
"""What tells a sticky valve from an uneven wave, where the record does not."""

_LENGTHEN = (
    "Lengthen the integral time: at the period of the oscillation integral action is the larger "
    "part of the controller's answer. A lower gain alone may make it worse, as in a level. See the "
    "proposed settings, if any."
)
"""What helps where the period is longer than 2 pi integral times (the slow cycle of a level)."""
_GIVES_THE_SETPOINT = (
    "Look at what gives the set-point: the master loop, a ratio or a program; this loop follows it."
)


def sticky_weight(found: Gathered) -> float:
    """Weight of a sticky valve: the share of PV's motion that it makes."""
    assert found.explained is not None
    swings = found.swing.share if found.swing.present else 0.0
    return min(1.0, max(found.explained.effect, swings))


def uneven_wave_words(found: Gathered, settings: DiagnosisSettings) -> str:
    """Say that a wave from outside that swings unevenly may stand for the sticky valve."""
    assert found.explained is not None
    over = found.explained.over_waves
    if over < 0.0:
        return (
            f"a wave from outside that swings unevenly explains PV better than a sticky valve whose"
            f" slips vary (log Bayes factor {-over:.0f}), if not by enough to be sure of it: "
            f"either is possible"
        )
    return (
        f"a wave from outside that swings unevenly explains PV about as well as a sticky valve "
        f"whose slips vary (log Bayes factor of the valve {over:.0f}, "
        f"{settings.judging.threshold:g} are needed): either is possible"
    )


def is_aperiodic(found: Gathered, settings: DiagnosisSettings) -> bool:
    """Whether disturbances without a period explain what looks like an oscillation.

    The periods scatter, the loop does not amplify them, and a wave from outside is not needed.
    """
    one, judging = found.explained, settings.judging
    if one is None or found.loop is None or found.is_sticky or found.setpoint_swings:
        return False
    here, _ = found.amplification()
    if not found.swing.present or here > judging.tight or _keeps_phase(found, settings):
        return False
    # regular periods alone may be chance: they need evidence against a wave
    limit = judging.unsure if found.swing.regularity < judging.steady else -judging.unsure
    return _outside(found, settings) < limit


def _outside(found: Gathered, settings: DiagnosisSettings) -> float:
    """Evidence that something outside makes the oscillation, nats.

    It is the likelihood of a wave of steady size, or of a resonance, over that of the loop with its
    noise. That hardly sees a machine whose size changes, which the process takes for a resonance of
    its own; but no noise changes the size and keeps the phase, nor the other way round. At a limit
    of OP, or with a gap of the controller, a loop that swings by itself keeps its size as well.
    """
    assert found.explained is not None
    judging = settings.judging
    keeps_size = found.limits.share > settings.facts.least_limit or found.has_gap
    if found.unlike_noise < judging.threshold or keeps_size:
        return found.explained.outside
    return max(found.explained.outside, found.unlike_noise)


def _keeps_phase(found: Gathered, settings: DiagnosisSettings) -> bool:
    judging = settings.judging
    return has_steady_period(found.swing, judging) and found.swing.decay >= judging.kept


def _wanders(found: Gathered, settings: DiagnosisSettings) -> bool:
    """Whether amplitude and phase are seen to wander, so that noise keeps the oscillation going.

    A steady one tells nothing: a loop near its limit of stability has it as well as a wave.
    """
    judging = settings.judging
    if found.swing.cycles < judging.lasting_periods or found.in_phase >= judging.in_phase:
        return False
    if found.unlike_noise >= judging.threshold:
        return False
    return found.amplitude > judging.wanders


def _is_noise(found: Gathered, settings: DiagnosisSettings) -> bool:
    """Whether noise makes the oscillation, by its amplitude and by what the likelihood says."""
    one = found.explained
    against = one is not None and _outside(found, settings) < -settings.judging.unsure
    return against and _wanders(found, settings)


def _rings(found: Gathered, settings: DiagnosisSettings) -> bool:
    """Whether the loop's own resonance makes the oscillation."""
    if found.loop is None or found.explained is None or not found.swing.present:
        return False
    judging = settings.judging
    here, _ = found.amplification()
    beside = found.amplification_beside_wave()
    if here <= judging.tight:
        return False
    if beside <= judging.well:
        # beside a wave a noisy resonance is whitened away: that counts where a wave may be there
        return _is_noise(found, settings)
    # what shows beside the oscillation amplifies it as well: a wave needs positive evidence
    unsure = judging.unsure if beside > judging.tight else -judging.unsure
    if _outside(found, settings) >= unsure:
        return False
    # a swing that dies out more slowly than the record is long looks like a wave from outside
    _, damping = found.loop.swing()
    dies = 2.0 * math.pi * max(damping, 0.0) * found.swing.cycles
    at_limit = found.limits.share > settings.facts.least_limit
    return dies > judging.dies or at_limit or beside > judging.endless or _wanders(found, settings)


def _seems_to_ring(found: Gathered, settings: DiagnosisSettings) -> bool:
    """Whether the identified loop swings by itself where no oscillation is seen."""
    one, judging = found.explained, settings.judging
    if one is None or found.loop is None:
        return False
    _, peak = found.amplification()
    period, damping = found.loop.swing()
    return (
        damping < judging.damping
        and peak > 2.0 * judging.tight
        and one.process > 2.0 * judging.threshold
        and 4.0 < period < 0.05 * found.samples
    )


def may_be_swung(found: Gathered, settings: DiagnosisSettings) -> bool:
    """Whether the loop that seems to swing by itself may be swung from outside as well.

    A process takes a wave that nobody sees for its own resonance: the loop alone must be likelier
    than a wave of that period, by as much as any explanation over its rivals.
    """
    return _seems_to_ring(found, settings) and found.own_wave > -settings.judging.threshold


def find_tight(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    """Tight tuning, if the loop swings by itself or nearly does; None if not."""
    one, judging = found.explained, settings.judging
    controller = found.controller
    if one is None or found.loop is None or controller is None or found.is_sticky:
        return None
    if found.has_gap:
        # within the gap the loop is open: it is not the linear one of the settings read off
        return None
    if one.sticking > settings.judging.unsure:
        # the process of a healthy valve says little where a sticky one is likelier
        return None
    here, peak = found.amplification()
    margins = found.loop.margins()
    period, damping = found.loop.swing()
    if found.swing.present and not is_aperiodic(found, settings):
        if not _rings(found, settings):
            return None
        weight = found.swing.share * max(0.0, 1.0 - (judging.well / here) ** 2)
        evidence = (
            f"the loop itself amplifies disturbances {digits(here, 3)} times at the period of the "
            f"oscillation (well-tuned loops 1.4 to 2), and no wave from outside is needed (log "
            f"Bayes factor {one.outside:.0f})",
        )
    elif _seems_to_ring(found, settings) and not may_be_swung(found, settings):
        weight = max(0.0, 1.0 - (judging.well / peak) ** 2) * 0.5
        evidence = (
            f"the closed loop swings with a period of {digits(period * found.loop.period, 3)} s "
            f"at a damping ratio of {damping:.2f}; Ms is {digits(peak, 3)} (well-tuned loops 1.4 "
            f"to 2)",
        )
    else:
        return None
    known = (
        (f"gain margin {margins.gain:.2f}", margins.gain),
        (f"phase margin {margins.phase_deg:.0f} degrees", margins.phase_deg),
    )
    figures = ", ".join(text for text, value in known if math.isfinite(value))
    is_integral = _swing_period_s(found) > 2.0 * math.pi * controller.integral_time_s
    rough = (
        f"the controller's settings as read off explain only {controller.explained:.0%} of OP's "
        f"moves: these figures are rough"
    )
    said = (*evidence, figures if figures else "", "" if found.is_read(settings) else rough)
    return Cause(
        CauseName.TIGHT_TUNING,
        min(1.0, weight),
        tuple(filter(None, said)),
        _LENGTHEN if is_integral else "",
    )


def _swing_period_s(found: Gathered) -> float:
    """Period of the oscillation, or where there is none of the loop's own swing, s."""
    assert found.loop is not None
    return (
        found.swing.period_s if found.swing.present else found.loop.swing()[0] * found.loop.period
    )


def find_outside(found: Gathered, settings: DiagnosisSettings) -> Cause | None:
    """An oscillation from outside, if the record shows one; None if not."""
    one, swing = found.explained, found.swing
    if found.doubts_valve(settings):
        return Cause(
            CauseName.EXTERNAL_OSCILLATION,
            sticky_weight(found),
            (uneven_wave_words(found, settings),),
            f"{VALVE_OR_OUTSIDE} {CauseName.EXTERNAL_OSCILLATION.action}",
        )
    if one is not None and one.wave is not None:
        # the valve's own cycle comes before it: the wave alone would leave the valve unexplained
        return Cause(
            CauseName.EXTERNAL_OSCILLATION,
            min(found.wave_share, 0.99 * sticky_weight(found)),
            (
                f"beside the sticky valve there is a wave of {digits(one.wave.period_s, 4)} s from "
                f"outside: log Bayes factor {one.wave.evidence:.0f}",
            ),
        )
    open_loop = found.open_swing
    least = settings.judging.told
    share = found.open_share
    if open_loop is swing:
        # what swings for the whole record is told however much a limit costs
        share = max(share, least)
    if open_loop is not None and share >= least and not found.is_sticky:
        return Cause(
            CauseName.EXTERNAL_OSCILLATION,
            share,
            (
                f"PV oscillates with a period of {digits(open_loop.period_s, 4)} s also while OP "
                f"is in manual or at a limit: the loop does not make it",
            ),
        )
    if not swing.present or not found.has_pv or found.is_sticky:
        return None
    # the loop follows a set-point that swings; a wave that PV shows beside that comes by itself
    enters = one is not None and one.outside >= settings.judging.threshold
    if found.setpoint_swings and not enters:
        return Cause(
            CauseName.EXTERNAL_OSCILLATION,
            swing.share,
            (f"the set-point itself oscillates with a period of {digits(swing.period_s, 4)} s",),
            _GIVES_THE_SETPOINT,
        )
    if one is None or one.model is None or is_aperiodic(found, settings):
        return None
    here, _ = found.amplification()
    beside = found.amplification_beside_wave()
    judging = settings.judging
    # a process that is fitted to a steady wave takes it for its own resonance
    is_swung = here > judging.tight and beside <= judging.well and not _is_noise(found, settings)
    outside = _outside(found, settings)
    hardly_shows = one.process < judging.threshold and outside < judging.threshold
    if hardly_shows and _wanders(found, settings):
        # a process that hardly shows does not tell how the loop amplifies what noise keeps going
        return None
    if one.sticking > max(judging.unsure, outside):
        # a sticky valve explains it better, if not by enough for a verdict
        return None
    if outside < judging.unsure and (found.has_gap or not found.is_read(settings)):
        # no wave shows, and how the loop amplifies is that of a controller that it has not
        return None
    if not is_swung:
        if outside < judging.unsure and (here > judging.tight or found.loop is None):
            return None
        if found.amplification_at_steepest() > judging.tight and one.curved >= judging.threshold:
            # where the characteristic is steepest the loop swings by itself
            return None
        if outside < -judging.unsure and not _keeps_phase(found, settings):
            # the loop and smooth noise explain the hump: nothing steady is outside
            return None
    evidence = [
        f"a wave of {digits(swing.period_s, 4)} s from outside explains PV better than the loop "
        f"alone: log Bayes factor {one.outside:.0f}"
        if one.outside > 0.0
        else "neither valve nor tuning makes this oscillation",
    ]
    if found.unlike_noise >= judging.threshold and outside > one.outside:
        evidence = [
            f"a wave of {digits(swing.period_s, 4)} s comes from outside: its size and its phase "
            f"change unlike each other, which noise in a tight loop does not do (log Bayes factor "
            f"{found.unlike_noise:.0f})",
        ]
    if is_swung:
        evidence.append(
            f"by what the record shows beside the oscillation the loop amplifies disturbances of "
            f"this period only {digits(beside, 2)} times"
        )
    elif here <= judging.tight:
        evidence.append(
            f"the loop amplifies disturbances of this period only {digits(here, 2)} times"
        )
    if found.setpoint_swings:
        evidence.append(
            "the set-point oscillates too, but what PV does beside OP does not come from there: a "
            "master that answers this loop swings with it"
        )
    return Cause(CauseName.EXTERNAL_OSCILLATION, swing.share, tuple(evidence))
