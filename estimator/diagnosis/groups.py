"""Loops that swing together, and which of them started it.

    for group in find_groups(signals, diagnoses):
        group.loops, group.period_s, group.candidates[0].loop

Every oscillation of every loop is brought to a complex amplitude over the common hours (the signal
in a narrow band around the period, turned back by that frequency). Loops of one event have
amplitudes that keep their ratio and phase; the coherence says how well, whatever the sampling of
each, and chance is allowed for by the number of independent values and of pairs that were tried.

The source of an event is the loop that makes its oscillation itself: a sticky valve or a tuning
that swings, by the diagnosis of each loop. Harmonics, which processes take away, and the share of
the oscillation in the loop's motion speak for nearness to the source (Thornhill 2005, "Finding the
source of nonlinearity in a process with plant-wide oscillation", IEEE Transactions on Control
Systems Technology 13, 434-443). Where no loop makes it, it comes from outside.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from estimator.diagnosis.cascades import Cascade, find_cascades
from estimator.diagnosis.coherence import (
    LoopSignals,
    amplitudes,
    coherence,
    common_grid,
    compared_signal,
    harmonics_of,
    on_one_grid,
    share_in_band,
)
from estimator.diagnosis.leading import leads
from estimator.diagnosis.oscillation import Oscillation, detect_oscillations
from estimator.diagnosis.result import CauseName, Diagnosis
from estimator.diagnosis.settings import DIAGNOSIS, DiagnosisSettings, Grouping

__all__ = ["Candidate", "Group", "find_groups"]


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
class Group:
    """Loops that swing together with one period; candidates for the source, the likeliest first."""

    loops: tuple[str, ...]
    period_s: float
    candidates: tuple[Candidate, ...]
    cascades: tuple[Cascade, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The JSON object of a group of ``fieldlink diagnose --json``."""
        return {
            "loops": list(self.loops),
            "period_s": self.period_s,
            "candidates": [one.to_dict() for one in self.candidates],
            "cascades": [
                {"master": one.master, "slave": one.slave, "explained": one.explained}
                for one in self.cascades
            ],
        }


@dataclass(frozen=True, slots=True)
class _Swing:
    """An oscillation of a loop, by the signal that shows it."""

    loop: str
    found: Oscillation


def find_groups(
    signals: Mapping[str, LoopSignals],
    diagnoses: Mapping[str, Diagnosis],
    *,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> tuple[Group, ...]:
    """Find the groups of loops that swing together.

    Args:
        signals: by name of the loop.
        diagnoses: of the same loops.
        settings: see `estimator.diagnosis.settings`.

    Returns:
        Groups of two loops and more, the largest first. A loop may be in several groups, with
        another period in each.
    """
    swings = [
        _Swing(name, found)
        for name, one in signals.items()
        for found in _swings_of(one, settings)
        if found.present or _may_cycle(diagnoses[name], found, settings)
    ]
    swings.sort(key=lambda one: -one.found.regularity * one.found.cycles)
    cascades = find_cascades(signals, settings)
    groups: list[Group] = []
    used: set[int] = set()
    for i, seed in enumerate(swings):
        if i in used:
            continue
        members = _members(seed, signals, swings, settings.grouping)
        if len(members) < 2:
            continue
        for j, other in enumerate(swings):
            near = abs(other.found.period_s / seed.found.period_s - 1.0) < settings.grouping.same
            if other.loop in members and near:
                used.add(j)
        names = tuple(name for name in signals if name in members)
        if any(_same_event(names, seed.found.period_s, group, settings) for group in groups):
            continue
        inside = tuple(one for one in cascades if one.master in members and one.slave in members)
        groups.append(
            Group(
                names,
                seed.found.period_s,
                _candidates(names, seed.found.period_s, signals, diagnoses, inside, settings),
                inside,
            )
        )  # fmt: skip
    return tuple(sorted(groups, key=lambda group: -len(group.loops)))


def _swings_of(one: LoopSignals, settings: DiagnosisSettings) -> list[Oscillation]:
    return list(
        detect_oscillations(compared_signal(one), period=one.period, settings=settings.swinging)
    )


def _may_cycle(diagnosis: Diagnosis, found: Oscillation, settings: DiagnosisSettings) -> bool:
    """Whether an irregular oscillation may be the cycle of a valve that is known to stick."""
    sticks = any(cause.name is CauseName.STICKY_VALVE for cause in diagnosis.causes)
    return sticks and found.decay > settings.grouping.cycle


def _members(
    seed: _Swing,
    signals: Mapping[str, LoopSignals],
    swings: list[_Swing],
    grouping: Grouping,
) -> dict[str, float]:
    """Loops coherent with the seed's oscillation, each with its coherence."""
    period = seed.found.period_s
    grid = common_grid(signals, period)
    mine, known = amplitudes(signals[seed.loop], 1.0 / period, grid, grouping.width)
    swinging = {
        one.loop for one in swings if abs(one.found.period_s / period - 1.0) < grouping.same
    }
    members = {seed.loop: 1.0}
    pairs = max(1, len(signals) * (len(signals) - 1) // 2)
    for name, one in signals.items():
        # a period needs four samples
        if name == seed.loop or one.period > 0.25 * period:
            continue
        other, known_too = amplitudes(one, 1.0 / period, grid, grouping.width)
        found, values = coherence(mine, other, known & known_too)
        # values half a period apart, in a band of this width
        free = max(2.0, values * grouping.width)
        # a loop without an oscillation of its own has the periods of all others to agree with
        tried = pairs if name in swinging else pairs * len(swings)
        chance = math.sqrt(1.0 - (grouping.chance / tried) ** (1.0 / (free - 1.0)))
        least = grouping.coherence if name in swinging else grouping.hidden
        if found > max(chance, least) and (
            name in swinging or share_in_band(one, period) > grouping.share
        ):
            members[name] = found
    return members


def _same_event(
    names: tuple[str, ...], period: float, group: Group, settings: DiagnosisSettings
) -> bool:
    """Whether it is a group that was found already, or a harmonic of it."""
    ratio = group.period_s / period
    harmonic = abs(ratio - round(ratio)) < settings.grouping.same * ratio and ratio > 0.9
    return harmonic and len(set(names) & set(group.loops)) >= 0.5 * len(names)


def _candidates(
    names: tuple[str, ...],
    period: float,
    signals: Mapping[str, LoopSignals],
    diagnoses: Mapping[str, Diagnosis],
    cascades: tuple[Cascade, ...],
    settings: DiagnosisSettings,
) -> tuple[Candidate, ...]:
    """The members and the outside, each with its evidence, the likeliest first."""
    grouping = settings.grouping
    harmonics = {name: harmonics_of(signals[name], period, grouping.width) for name in names}
    shares = {name: share_in_band(signals[name], period) for name in names}
    most = max(harmonics.values(), default=0.0)
    ahead = leads(on_one_grid(names, signals, period, grouping), grouping)
    scores: list[tuple[float, str | None, tuple[str, ...], tuple[str, ...]]] = []
    for name in names:
        score = 0.0
        evidence: list[str] = []
        against: list[str] = []
        made, text = _makes(diagnoses[name], period, settings)
        score += made
        (evidence if made > 0.0 else against).append(text)
        if most > 0.0:
            score += grouping.harmonics * harmonics[name] / most
            (evidence if harmonics[name] > 0.7 * most else against).append(
                f"harmonics of {harmonics[name]:.0%} of the oscillation in its error (the group's "
                f"largest: {most:.0%})"
            )
        score += grouping.strength * shares[name]
        if shares[name] > 0.3:
            evidence.append(f"the oscillation is {shares[name]:.0%} of its motion")
        score += grouping.leads * ahead[name]
        (evidence if ahead[name] > 0.0 else against).append(
            f"its past tells the others' future {'better' if ahead[name] > 0.0 else 'worse'} than "
            f"theirs tells its own (lead {ahead[name]:+.2f} of 1)"
        )
        for cascade in cascades:
            if cascade.master == name:
                score -= grouping.strength
                against.append(f"its OP is the set-point of {cascade.slave}, which moves the valve")
        scores.append((score, name, tuple(evidence), tuple(against)))
    # where no loop makes the oscillation itself it comes from outside, whichever loop shows it most
    is_made = any(_makes(diagnoses[name], period, settings)[0] > 0.0 for name in names)
    most_likely = max(score for score, *_ in scores)
    outside = grouping.outside if is_made else most_likely + grouping.unmade
    scores.append((
        outside, None,
        ("no loop of the group must be its source: a machine, a batch or a loop not given may be",),
        (),
    ))  # fmt: skip
    total = sum(math.exp(score) for score, *_ in scores)
    scores.sort(key=lambda one: -one[0])
    return tuple(
        Candidate(name, math.exp(score) / total, evidence, against)
        for score, name, evidence, against in scores
    )


def _makes(diagnosis: Diagnosis, period: float, settings: DiagnosisSettings) -> tuple[float, str]:
    """Score and sentence: does the loop make the oscillation itself?"""
    grouping = settings.grouping
    own = diagnosis.oscillation.period_s
    same = math.isfinite(own) and abs(own / period - 1.0) < grouping.same
    weights = {cause.name: cause for cause in diagnosis.causes}
    sticky = weights.get(CauseName.STICKY_VALVE)
    if sticky is not None:
        return grouping.sticky, f"its valve sticks: {sticky.evidence[0]}"
    tight = weights.get(CauseName.TIGHT_TUNING)
    if tight is not None and same:
        return grouping.tight, f"its tuning swings: {tight.evidence[0]}"
    outside = weights.get(CauseName.EXTERNAL_OSCILLATION)
    if outside is not None and same:
        return -grouping.external, f"it swings because of others: {outside.evidence[0]}"
    return 0.0, f"its own diagnosis does not make it the source: {diagnosis.first.name.words}"
