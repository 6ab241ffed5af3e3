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

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from estimator.diagnosis.leading import leads
from estimator.diagnosis.oscillation import Oscillation, bridge, detect_oscillations
from estimator.diagnosis.result import CauseName, Diagnosis
from estimator.diagnosis.settings import DIAGNOSIS, DiagnosisSettings, Grouping
from estimator.lanes import Array, Mask

__all__ = ["Candidate", "Cascade", "Group", "LoopSignals", "find_cascades", "find_groups"]

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class LoopSignals:
    """The signals of one loop over hours that the loops of a plant have in common.

    ``op``, ``pv``, ``sp`` are ``(n,)``, NaN where bad, ``pv`` and ``sp`` None where not recorded;
    ``period`` is the seconds between samples, ``start_s`` when the first one was taken.
    """

    op: Array
    pv: Array | None
    sp: Array | None
    period: float
    start_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Cascade:
    """``master``'s OP is ``slave``'s set-point, to within a scale; ``explained`` is its share."""

    master: str
    slave: str
    explained: float


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


def find_cascades(
    signals: Mapping[str, LoopSignals], settings: DiagnosisSettings = DIAGNOSIS
) -> tuple[Cascade, ...]:
    """Loops whose set-point is another loop's OP, found by regression; both must move."""
    found = []
    grouping = settings.grouping
    for slave, one in signals.items():
        if one.sp is None or not np.isfinite(one.sp).any():
            continue
        sp = bridge(one.sp)
        # a cascade's set-point moves all the time
        if float(np.mean(np.diff(sp) != 0.0)) < grouping.moving:
            continue
        best: tuple[float, str] | None = None
        for master, other in signals.items():
            if master == slave:
                continue
            explained = _explained(sp, one, bridge(other.op), other)
            if best is None or explained > best[0]:
                best = (explained, master)
        if best is not None and best[0] > grouping.cascade:
            found.append(Cascade(best[1], slave, best[0]))
    return tuple(found)


def _explained(sp: Array, one: LoopSignals, op: Array, other: LoopSignals) -> float:
    """Share of the set-point's variance that a straight line of the other's OP explains."""
    at = one.start_s + one.period * np.arange(sp.size)
    have = other.start_s + other.period * np.arange(op.size)
    inside = (at >= have[0]) & (at <= have[-1])
    if inside.sum() < 20 or np.ptp(op) == 0.0:
        return 0.0
    best = 0.0
    for late in (0.0, one.period):
        x = np.interp(at[inside] - late, have, op)
        y = sp[inside]
        if np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
            continue
        best = max(best, float(np.corrcoef(x, y)[0, 1]) ** 2)
    return best


def _signal(one: LoopSignals) -> Array:
    """What the members of a group are compared by: the control error, PV, or OP."""
    if one.pv is None:
        return np.asarray(one.op, dtype=np.float64)
    if one.sp is None or not np.isfinite(one.sp).any():
        return np.asarray(one.pv, dtype=np.float64)
    return np.asarray(one.sp - one.pv)


def _swings_of(one: LoopSignals, settings: DiagnosisSettings) -> list[Oscillation]:
    return list(detect_oscillations(_signal(one), period=one.period, settings=settings.swinging))


def _may_cycle(diagnosis: Diagnosis, found: Oscillation, settings: DiagnosisSettings) -> bool:
    """Whether an irregular oscillation may be the cycle of a valve that is known to stick."""
    sticks = any(cause.name is CauseName.STICKY_VALVE for cause in diagnosis.causes)
    return sticks and found.decay > settings.grouping.cycle


def _amplitudes(
    one: LoopSignals, frequency: float, grid: Array, width: float, harmonic: int = 1
) -> tuple[Complex, Mask]:
    """Complex amplitudes at the times of ``grid`` of the band around a frequency (1/s)."""
    raw = _signal(one)
    good = np.isfinite(raw)
    x = bridge(raw)
    k = np.arange(x.size)
    x = x - np.polyval(np.polyfit(k, x, 1), k)
    n = x.size
    padded = fft.next_fast_len(2 * n)
    spectrum = np.asarray(fft.fft(np.concatenate([x, x[::-1]]), padded))
    f = np.asarray(fft.fftfreq(padded, one.period))
    half = width * frequency
    away = np.abs(f - harmonic * frequency)
    window = np.where(away < half, 0.5 + 0.5 * np.cos(math.pi * away / half), 0.0)
    band = np.asarray(fft.ifft(2.0 * spectrum * window))[:n]
    times = one.start_s + one.period * k
    turned = band * np.exp(-2j * math.pi * harmonic * frequency * times)
    inside = (grid >= times[0]) & (grid <= times[-1])
    z = np.interp(grid, times, turned.real) + 1j * np.interp(grid, times, turned.imag)
    known = inside & (np.interp(grid, times, good.astype(float)) > 0.99)
    return z, known


def _grid(signals: Mapping[str, LoopSignals], period: float) -> Array:
    """Times at which amplitudes are compared: the hours that any two loops have, a period apart."""
    start = min(one.start_s for one in signals.values())
    stop = max(one.start_s + one.period * one.op.size for one in signals.values())
    return np.arange(start, stop, 0.5 * period)


def _coherence(a: Complex, b: Complex, both: Mask) -> tuple[float, float]:
    """Coherence of two amplitudes, and the number of values it rests on."""
    if int(both.sum()) < 4:
        return 0.0, 0.0
    x, y = a[both], b[both]
    power = float(np.sum(np.abs(x) ** 2) * np.sum(np.abs(y) ** 2))
    if power <= 0.0:
        return 0.0, 0.0
    return float(abs(np.sum(x * np.conj(y)))) / math.sqrt(power), float(both.sum())


def _members(
    seed: _Swing,
    signals: Mapping[str, LoopSignals],
    swings: list[_Swing],
    grouping: Grouping,
) -> dict[str, float]:
    """Loops coherent with the seed's oscillation, each with its coherence."""
    period = seed.found.period_s
    grid = _grid(signals, period)
    mine, known = _amplitudes(signals[seed.loop], 1.0 / period, grid, grouping.width)
    swinging = {
        one.loop for one in swings if abs(one.found.period_s / period - 1.0) < grouping.same
    }
    members = {seed.loop: 1.0}
    pairs = max(1, len(signals) * (len(signals) - 1) // 2)
    for name, one in signals.items():
        # a period needs four samples
        if name == seed.loop or one.period > 0.25 * period:
            continue
        other, known_too = _amplitudes(one, 1.0 / period, grid, grouping.width)
        found, values = _coherence(mine, other, known & known_too)
        # values half a period apart, in a band of this width
        free = max(2.0, values * grouping.width)
        chance = math.sqrt(1.0 - (grouping.chance / pairs) ** (1.0 / (free - 1.0)))
        least = grouping.coherence if name in swinging else grouping.hidden
        if found > max(chance, least) and (
            name in swinging or _share(one, period) > grouping.share
        ):
            members[name] = found
    return members


def _share(one: LoopSignals, period: float) -> float:
    """Share of the loop's motion in the narrow band."""
    grid = np.arange(one.start_s, one.start_s + one.period * one.op.size, 0.5 * period)
    z, known = _amplitudes(one, 1.0 / period, grid, 0.2)
    whole = float(np.nanvar(_signal(one)))
    return (
        0.5 * float(np.mean(np.abs(z[known]) ** 2)) / whole if whole > 0.0 and known.any() else 0.0
    )


def _same_event(
    names: tuple[str, ...], period: float, group: Group, settings: DiagnosisSettings
) -> bool:
    """Whether it is a group that was found already, or a harmonic of it."""
    ratio = group.period_s / period
    harmonic = abs(ratio - round(ratio)) < settings.grouping.same * ratio and ratio > 0.9
    return harmonic and len(set(names) & set(group.loops)) >= 0.5 * len(names)


def _harmonics(one: LoopSignals, period: float, width: float) -> float:
    """Amplitude of the second and third harmonic over the first, PV's own; 0 where too fast."""
    grid = np.arange(one.start_s, one.start_s + one.period * one.op.size, 0.5 * period)
    sizes = []
    for h in (1, 2, 3):
        if h / period > 0.4 / one.period:
            sizes.append(0.0)
            continue
        z, known = _amplitudes(one, 1.0 / period, grid, width, h)
        sizes.append(abs(float(np.mean(np.abs(z[known])))) if known.any() else 0.0)
    return math.hypot(sizes[1], sizes[2]) / sizes[0] if sizes[0] > 0.0 else 0.0


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
    harmonics = {name: _harmonics(signals[name], period, grouping.width) for name in names}
    shares = {name: _share(signals[name], period) for name in names}
    most = max(harmonics.values(), default=0.0)
    ahead = leads(_on_one_grid(names, signals, period, grouping), grouping)
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
    # where no loop makes the oscillation itself it comes from outside, whoever shows it most
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


def _on_one_grid(
    names: tuple[str, ...],
    signals: Mapping[str, LoopSignals],
    period: float,
    grouping: Grouping,
) -> dict[str, Array]:
    """The signals at common times, some a period; NaN in their gaps."""
    chosen = {name: signals[name] for name in names}
    start = max(one.start_s for one in chosen.values())
    stop = min(one.start_s + one.period * one.op.size for one in chosen.values())
    step = max(period / grouping.per_period, *(one.period for one in chosen.values()))
    grid = np.arange(start, stop, step)
    found = {}
    for name, one in chosen.items():
        raw = _signal(one)
        times = one.start_s + one.period * np.arange(raw.size)
        values = np.interp(grid, times, bridge(raw))
        known = np.interp(grid, times, np.isfinite(raw).astype(float)) > 0.99
        found[name] = np.where(known, values - values.mean(), np.nan)
    return found


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
