"""Loops that swing together.

    for group in find_groups(signals, diagnoses):
        group.loops, group.period_s, group.candidates[0].loop

Every oscillation of every loop is brought to a complex amplitude over the common hours (the signal
in a band around the period, turned back by that frequency). Loops of one event have amplitudes that
keep their ratio and phase; the coherence says how well, whatever the sampling of each.

Chance is allowed for twice. Amplitudes that wander agree seldom by chance: the probability follows
from the number of independent values, counted from both spectra. Two steady waves agree as soon as
their periods do, which two independent loops have as seldom as there are periods to tell apart. A
group must be less likely by chance than all the groups of its size that the plant could have shown.

Two loops at least must oscillate visibly, or one must swing by its own valve or tuning and its past
tell another's future: that needs no period. A loop whose valve sticks at irregular times makes no
oscillation and may still move others: only such a lead tells, not that the motions are alike.

Which loop started it is decided in `estimator.diagnosis.sources`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.diagnosis.cascades import Cascade, find_cascades
from estimator.diagnosis.coherence import (
    LoopSignals,
    LoopSpectrum,
    agreement,
    compared_signal,
    on_one_grid,
    spectrum_of,
)
from estimator.diagnosis.leading import chance_of_lead
from estimator.diagnosis.oscillation import Oscillation, detect_oscillations
from estimator.diagnosis.result import Cause, CauseName, Diagnosis
from estimator.diagnosis.settings import DIAGNOSIS, DiagnosisSettings
from estimator.diagnosis.sources import (
    Candidate,
    GroupMembers,
    evidence_of_valve,
    is_valve_doubted,
    rank_candidates,
)

__all__ = ["Group", "find_groups"]


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
    """An oscillation of a loop; ``irregular`` where a sticky valve moves at its own odd times.

    ``made`` where the loop's own valve or tuning makes it; ``sticking`` nats speak for its valve.
    """

    loop: str
    found: Oscillation
    irregular: bool = False
    made: bool = False
    sticking: float = 0.0

    @property
    def order(self) -> tuple[float, bool, float]:
        """The smallest is asked first who follows it: what a valve moves may swing by itself."""
        return -self.sticking, self.irregular, -self.found.regularity * self.found.cycles


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
    spectra = {name: spectrum_of(one) for name, one in signals.items()}
    swings = [swing for name in signals for swing in _swings_of(name, signals, diagnoses, settings)]
    # what a sticky valve moves may swing by itself after each of its slips, or look sticky
    swings.sort(key=lambda one: one.order)
    cascades = find_cascades(signals, settings)
    groups: list[Group] = []
    wide: list[Group] = []
    used: set[int] = set()
    for i, seed in enumerate(swings):
        if i in used:
            continue
        linked = {one.slave for one in cascades if one.master == seed.loop}
        linked |= {one.master for one in cascades if one.slave == seed.loop}
        members = _members(seed, signals, spectra, swings, linked, settings)
        if len(members) < 2:
            continue
        period = seed.found.period_s
        names = tuple(name for name in signals if name in members)
        inside = tuple(one for one in cascades if one.master in members and one.slave in members)
        # a slave's own valve or tuning may be the source, what it follows is its master's
        is_event = seed.made or _is_event(
            members - {one.slave for one in inside}, diagnoses, settings
        )
        for j, other in enumerate(swings):
            is_asked = is_event or not other.made
            if is_asked and other.loop in members and _is_near(other, period, settings):
                used.add(j)
        if not is_event or any(_same_event(names, period, group, settings) for group in groups):
            continue
        if any(_same_event(names, period, group, settings, is_wide=True) for group in wide):
            continue
        # a motion at odd times has no period that could tell it from what its loop is part of
        if seed.irregular and any(
            seed.loop in group.loops and _is_mostly_in(names, group) for group in (*groups, *wide)
        ):
            continue
        those = GroupMembers(names, period, signals, spectra, diagnoses, inside)
        candidates = rank_candidates(those, settings)
        found = Group(names, period, candidates, inside)
        (wide if seed.irregular else groups).append(found)
    return tuple(sorted((*groups, *wide), key=lambda group: -len(group.loops)))


def _swings_of(
    name: str,
    signals: Mapping[str, LoopSignals],
    diagnoses: Mapping[str, Diagnosis],
    settings: DiagnosisSettings,
) -> list[_Swing]:
    """The oscillations of a loop, or the main one of a loop whose valve sticks."""
    one = signals[name]
    all_found = detect_oscillations(
        compared_signal(one), period=one.period, settings=settings.swinging
    )
    causes = {cause.name for cause in diagnoses[name].causes}
    present = [found for found in all_found if found.present]
    # an uneven wave that may stand for the valve has a period like any other
    if CauseName.STICKY_VALVE not in causes or is_valve_doubted(diagnoses[name], settings):
        is_tight = any(_is_tight(cause, settings) for cause in diagnoses[name].causes)
        return [_Swing(name, found, made=is_tight) for found in present]
    nats = evidence_of_valve(diagnoses[name], 0.0)
    if not present:
        # the motions of a loop whose valve sticks, regular or not, the main one first
        return [_Swing(name, found, irregular=True, made=True, sticking=nats)
                for found in sorted(all_found, key=lambda found: -found.share)]  # fmt: skip
    regular = settings.grouping.regular
    return [_Swing(name, found, found.regularity < regular, made=True, sticking=nats)
            for found in present]  # fmt: skip


_NO_PERIOD = (
    CauseName.QUIET, CauseName.SLOW_TUNING, CauseName.CHARACTERISTIC, CauseName.SENSOR
)  # fmt: skip
"""Causes that make no oscillation which other loops could follow."""


def _is_tight(cause: Cause, settings: DiagnosisSettings) -> bool:
    """Whether it is a tuning that makes most of its loop's motion; less is amplified noise."""
    return cause.name is CauseName.TIGHT_TUNING and cause.weight >= settings.grouping.made


def _is_event(
    names: set[str], diagnoses: Mapping[str, Diagnosis], settings: DiagnosisSettings
) -> bool:
    """Whether the diagnosis of one loop at least finds more than noise in its oscillation.

    Coupled loops share their noise, and what it makes of similar loops may look like one wave. A
    slave follows its master's and does not count.
    """
    return any(
        _is_more_than_noise(cause, diagnoses[name], settings)
        for name in names
        for cause in diagnoses[name].causes
    )


def _is_more_than_noise(cause: Cause, of: Diagnosis, settings: DiagnosisSettings) -> bool:
    if cause.name is CauseName.TIGHT_TUNING:
        return _is_tight(cause, settings)
    if cause.name is not CauseName.UNDETERMINED:
        return cause.name not in _NO_PERIOD
    # as long as no wave from outside is refuted, or the loop may swing by itself
    judging, figures = settings.judging, of.indices
    is_refuted = figures.get("log_bayes_factor_outside", math.nan) <= -judging.threshold
    return not (is_refuted and figures["amplification_at_period"] <= judging.tight)


def _is_near(swing: _Swing, period: float, settings: DiagnosisSettings) -> bool:
    return abs(swing.found.period_s / period - 1.0) < settings.grouping.same


def _members(
    seed: _Swing,
    signals: Mapping[str, LoopSignals],
    spectra: Mapping[str, LoopSpectrum],
    swings: list[_Swing],
    linked: set[str],
    settings: DiagnosisSettings,
) -> set[str]:
    """Loops that agree with the seed's oscillation; the seed alone where none does.

    Loops ``linked`` with it in a cascade do not agree by chance.
    """
    grouping, period = settings.grouping, seed.found.period_s
    # coupled loops follow by the same chance: each must be sure by itself
    motions = sum(one.loop == seed.loop for one in swings)
    least, tried = math.log(grouping.chance), math.log(len(spectra) * motions)
    follow = _driven(seed, signals, spectra, swings, settings) if seed.made else set()
    if seed.irregular:
        # motions without a period that look alike may have a cause in common
        return {seed.loop, *follow}
    # a motion that is no oscillation has no period that could agree
    near = {one.loop for one in swings if one.found.present and _is_near(one, period, settings)}
    clear = {one.loop: one.found.prominence for one in swings}
    visible: dict[str, float] = {}
    hidden: dict[str, float] = {}
    together = {seed.loop, *follow}
    for name, other in _others(seed, spectra):
        if name not in near and other.share(period, grouping.width) < grouping.share:
            continue
        found = agreement(spectra[seed.loop], other, period, grouping.width, np.zeros(1))
        if name in near and found.coherence > grouping.coherence:
            if name in linked:
                together.add(name)
            visible[name] = found.chance() - _log_periods(seed, settings)
        elif found.coherence > grouping.hidden:
            # a period of a loop that swings in several ways is told less well
            (visible if name in clear else hidden)[name] = found.chance()
    chosen = _surest(visible, seed.loop, clear, least)
    if not chosen:
        return together
    beside = (one for one, at in hidden.items() if at + tried < least)
    return {*together, *chosen, *beside}


def _others(
    seed: _Swing, spectra: Mapping[str, LoopSpectrum]
) -> Iterator[tuple[str, LoopSpectrum]]:
    """The other loops whose sampling shows the seed's period, which needs four samples."""
    for name, other in spectra.items():
        if name != seed.loop and other.period <= 0.25 * seed.found.period_s:
            yield name, other


def _driven(
    seed: _Swing,
    signals: Mapping[str, LoopSignals],
    spectra: Mapping[str, LoopSpectrum],
    swings: list[_Swing],
    settings: DiagnosisSettings,
) -> set[str]:
    """Loops that the seed, which makes its own motion, moves: surer than by chance."""
    grouping, period = settings.grouping, seed.found.period_s
    # every motion of every loop that makes its own could have led
    tried = math.log(len(spectra) * sum(one.made for one in swings))
    found = set()
    for name, other in _others(seed, spectra):
        if other.share(period, grouping.wide) < grouping.share:
            continue
        alike = agreement(
            spectra[seed.loop], other, period, grouping.wide, np.array(grouping.delays)
        )
        if alike.coherence < grouping.driven:
            continue
        both = on_one_grid((seed.loop, name), signals, period, grouping)
        at = chance_of_lead(both[seed.loop], both[name], grouping)
        if at + tried < math.log(grouping.led):
            found.add(name)
    return found


def _log_periods(seed: _Swing, settings: DiagnosisSettings) -> float:
    """Logarithm of the number of periods that a loop could have had beside the seed's."""
    return math.log(max(1.0, settings.grouping.range * seed.found.cycles))


def _surest(
    chances: Mapping[str, float], seed: str, clear: Mapping[str, float], least: float
) -> set[str]:
    """The largest choice of loops that forms a group with the seed less likely than by chance.

    Args:
        chances: by loop, the logarithm of the probability that it agrees by chance.
        seed: the loop they agree with.
        clear: by loop that could have agreed, how clearly it swings: any choice among the loops
            that swing as clearly could have been the group.
        least: logarithm of the probability below which it is a group.
    """
    order = sorted(chances, key=lambda name: chances[name])
    total, size, faintest = 0.0, 0, clear[seed]
    for k, name in enumerate(order, start=1):
        total += chances[name]
        faintest = min(faintest, clear[name])
        comparable = sum(one >= faintest for one in clear.values())
        if total + math.log(math.comb(comparable, k + 1)) < least:
            size = k
    return set(order[:size])


def _same_event(
    names: tuple[str, ...],
    period: float,
    group: Group,
    settings: DiagnosisSettings,
    *,
    is_wide: bool = False,
) -> bool:
    """Whether it is a group that was found already, a harmonic of it, or part of its broad peak."""
    ratio = group.period_s / period
    grouping = settings.grouping
    is_harmonic = abs(ratio - round(ratio)) < grouping.same * ratio and ratio > 0.9
    is_all = set(names) <= set(group.loops)
    is_inside = abs(ratio - 1.0) < grouping.wide and (is_wide or is_all)
    return (is_harmonic or is_inside) and _is_mostly_in(names, group)


def _is_mostly_in(names: tuple[str, ...], group: Group) -> bool:
    """Whether the group holds half of those loops and more."""
    return len(set(names) & set(group.loops)) >= 0.5 * len(names)
