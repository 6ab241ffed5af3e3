"""Which loop of a group started it, or whether it comes from outside.

The source of an event is the loop that makes its oscillation itself: a sticky valve or a tuning
that swings, by the diagnosis of each loop. Harmonics, which processes take away, and how purely a
loop shows the oscillation speak for nearness to the source (Thornhill 2005, "Finding the source of
nonlinearity in a process with plant-wide oscillation", IEEE Transactions on Control Systems
Technology 13, 434-443), and so does a past that tells the others' future. Where no loop makes it,
it comes from outside.

A wave from outside hits many loops, and by itself each may look like a loop at its limit of
stability. Noise keeps such a loop going, so its amplitude wanders; that of a machine does not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from estimator.diagnosis.amplitude import variation_of
from estimator.diagnosis.cascades import Cascade
from estimator.diagnosis.coherence import LoopSignals, LoopSpectrum, harmonics_of, on_one_grid
from estimator.diagnosis.leading import leads
from estimator.diagnosis.result import CauseName, Diagnosis
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.diagnosis.wording import digits

__all__ = ["Candidate", "GroupMembers", "evidence_of_valve", "is_valve_doubted", "rank_candidates"]


@dataclass(frozen=True, slots=True)
class Candidate:
    """A possible source: ``loop`` is None for a cause outside the loops given."""

    loop: str | None
    weight: float
    evidence: tuple[str, ...]
    against: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain types."""
        return {
            "loop": self.loop,
            "weight": self.weight,
            "evidence": list(self.evidence),
            "against": list(self.against),
        }


@dataclass(frozen=True, slots=True)
class GroupMembers:
    """The loops ``names`` of a group with what is known of them, by name."""

    names: tuple[str, ...]
    period_s: float
    signals: Mapping[str, LoopSignals]
    spectra: Mapping[str, LoopSpectrum]
    diagnoses: Mapping[str, Diagnosis]
    cascades: tuple[Cascade, ...]


@dataclass(slots=True)
class _Case:
    """What speaks for a loop, and against it.

    ``score`` in nats; ``makes`` where its valve or tuning makes the oscillation.
    """

    loop: str
    score: float = 0.0
    makes: bool = False
    evidence: list[str] = field(default_factory=list)
    against: list[str] = field(default_factory=list)

    def add(self, score: float, text: str, is_for: bool) -> None:
        self.score += score
        (self.evidence if is_for else self.against).append(text)


def rank_candidates(group: GroupMembers, settings: DiagnosisSettings) -> tuple[Candidate, ...]:
    """The members and the outside, each with its evidence, the likeliest first."""
    grouping = settings.grouping
    cases = {name: _Case(name) for name in group.names}
    # loops that follow have the source's ups and downs, and noise of their own on top
    spectra = (group.spectra[name] for name in group.names)
    variation = min(variation_of(one, group.period_s, grouping.width) for one in spectra)
    for name, case in cases.items():
        score, case.makes, text = _own_cause(name, group, variation, settings)
        case.add(score, text, score > 0.0)
    _add_shape(group, cases, settings)
    _add_leads(group, cases, settings)
    for cascade in group.cascades:
        cases[cascade.master].add(
            -grouping.strength,
            f"its OP is the set-point of {cascade.slave}, which moves the valve",
            False,
        )
    # a loop that does not make the oscillation is no source, however much of it it shows
    if any(case.makes for case in cases.values()):
        outside = grouping.outside
        for case in cases.values():
            if not case.makes:
                case.score = min(case.score, outside - grouping.unmade)
    else:
        outside = max(case.score for case in cases.values()) + grouping.unmade
    found = [(case.score, case.loop, tuple(case.evidence), tuple(case.against))
             for case in cases.values()]  # fmt: skip
    text = "no loop of the group must be its source: a machine, a batch or a loop not given may be"
    everyone: list[tuple[float, str | None, tuple[str, ...], tuple[str, ...]]] = [
        *found, (outside, None, (text,), ())
    ]  # fmt: skip
    everyone.sort(key=lambda one: -one[0])
    first = everyone[0][0]
    total = math.fsum(math.exp(score - first) for score, *_ in everyone)
    return tuple(
        Candidate(name, math.exp(score - first) / total, evidence, against)
        for score, name, evidence, against in everyone
    )


def _add_shape(
    group: GroupMembers, cases: Mapping[str, _Case], settings: DiagnosisSettings
) -> None:
    """Harmonics, and how purely each loop shows the oscillation."""
    grouping, period = settings.grouping, group.period_s
    harmonics = {
        name: harmonics_of(group.spectra[name], period, grouping.width) for name in group.names
    }
    most = max(harmonics.values(), default=0.0)
    shares = {name: group.spectra[name].share(period, grouping.width) for name in group.names}
    # the source has no other disturbance between itself and the oscillation
    pure = {name: math.log(max(one, 0.01) / max(1.0 - one, 0.01)) for name, one in shares.items()}
    purest = max(pure.values())
    for name, case in cases.items():
        if most > 0.0:
            case.add(
                grouping.harmonics * harmonics[name] / most,
                f"harmonics of {harmonics[name]:.0%} of the oscillation in its error (the group's "
                f"largest: {most:.0%})",
                harmonics[name] > 0.7 * most,
            )
        bent = group.diagnoses[name].indices.get("bicoherence", math.nan)
        if bent > grouping.bicoherent:
            text = (
                f"its oscillation is not that of a linear loop with noise (bicoherence "
                f"{digits(bent, 2)})"
            )
            case.add(grouping.nonlinear, text, True)
        case.add(
            grouping.strength * (pure[name] - purest),
            f"the oscillation is {shares[name]:.0%} of its motion",
            pure[name] > purest - 1.0,
        )


def _add_leads(
    group: GroupMembers, cases: Mapping[str, _Case], settings: DiagnosisSettings
) -> None:
    """Who leads, among the likeliest: the others are no candidates for other reasons."""
    grouping = settings.grouping
    likely = sorted(cases.values(), key=lambda case: -case.score)[: grouping.compared]
    names = tuple(case.loop for case in likely)
    ahead = leads(on_one_grid(names, group.signals, group.period_s, grouping), grouping)
    for name, lead in ahead.items():
        cases[name].add(
            grouping.leads * lead,
            f"its past tells the others' future {'better' if lead > 0.0 else 'worse'} than theirs "
            f"tells its own (lead {lead:+.2f} of 1)",
            lead > 0.0,
        )


_OVER_WAVE = "log_bayes_factor_over_uneven_wave"


def evidence_of_valve(of: Diagnosis, unknown: float) -> float:
    """Nats for a sticky valve over every other explanation, an uneven wave from outside included.

    ``unknown`` where the diagnosis does not have them.
    """
    figures = (of.indices.get(name, math.nan) for name in ("log_bayes_factor_sticky", _OVER_WAVE))
    return min((one for one in figures if not math.isnan(one)), default=unknown)


def is_valve_doubted(of: Diagnosis, settings: DiagnosisSettings) -> bool:
    """Whether an uneven wave from outside may stand for a loop's valve: `Gathered.doubts_valve`."""
    return of.indices.get(_OVER_WAVE, math.nan) < settings.judging.threshold


def _is_of_group(wave_s: float, period_s: float, settings: DiagnosisSettings) -> bool:
    """Whether a wave has the group's period, or is a harmonic of what the group has."""
    grouping = settings.grouping
    if abs(wave_s / period_s - 1.0) < grouping.width:
        return True
    orders = {order for shape in settings.weighing.harmonics for order in shape}
    return any(abs(order * wave_s / period_s - 1.0) < grouping.same for order in orders)


def _own_cause(
    loop: str, group: GroupMembers, variation: float, settings: DiagnosisSettings
) -> tuple[float, bool, str]:
    """Score, whether the loop makes the oscillation itself, and a sentence.

    ``variation`` is the deviation of the oscillation's amplitude over its mean.
    """
    grouping, judging, period = settings.grouping, settings.judging, group.period_s
    diagnosis = group.diagnoses[loop]
    own = diagnosis.oscillation.period_s
    # a loop's own period is told less well than the group's: within the band is the same
    same = math.isfinite(own) and abs(own / period - 1.0) < grouping.width
    weights = {cause.name: cause for cause in diagnosis.causes}
    sticky, tight = weights.get(CauseName.STICKY_VALVE), weights.get(CauseName.TIGHT_TUNING)
    if sticky is not None:
        wave = diagnosis.indices.get("wave_beside_valve_period_s", math.nan)
        if _is_of_group(wave, period, settings):
            return -grouping.external, False, (
                f"beside its valve there is a wave of {digits(wave, 4)} s from outside, as the "
                f"group has it: that began elsewhere"
            )  # fmt: skip
        # a victim's steps look like strokes as well, but explain its PV by far less
        nats = evidence_of_valve(diagnosis, grouping.usual)
        score = grouping.sticky + grouping.evident * math.log(max(1.0, nats) / grouping.usual)
        if is_valve_doubted(diagnosis, settings):
            return score, score > grouping.outside, (
                f"its valve may stick, but an uneven wave from outside, as another loop would make "
                f"it, explains its PV about as well (log Bayes factor of the valve {nats:.0f})"
            )  # fmt: skip
        return score, score > grouping.outside, f"its valve sticks: {sticky.evidence[0]}"
    amplified = diagnosis.indices.get("amplification_at_period", math.nan)
    is_unsure = diagnosis.first.name is CauseName.UNDETERMINED and amplified > judging.tight
    if same and (tight is not None or is_unsure):
        is_long = diagnosis.oscillation.cycles >= judging.lasting_periods
        # at a limit of OP a tight loop keeps its size as well
        if is_long and variation < grouping.steady and CauseName.SATURATION not in weights:
            return 0.0, False, (
                f"the group's oscillation keeps its size (within {variation:.0%}): that of a tight "
                f"loop, which noise keeps going, wanders"
            )  # fmt: skip
        if tight is not None:
            return grouping.tight, True, f"its tuning swings: {tight.evidence[0]}"
        against_wave = -diagnosis.indices.get("log_bayes_factor_outside", math.nan)
        return grouping.maybe, against_wave >= judging.threshold, (
            f"it amplifies disturbances of this period {digits(amplified, 2)} times: it may swing "
            f"itself"
        )  # fmt: skip
    outside = weights.get(CauseName.EXTERNAL_OSCILLATION)
    if outside is not None and same:
        return -grouping.external, False, f"it swings because of others: {outside.evidence[0]}"
    words = diagnosis.first.name.words
    return 0.0, False, f"its own diagnosis does not make it the source: {words}"
