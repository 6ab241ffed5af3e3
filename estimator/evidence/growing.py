"""Nuisances found in what a hypothesis leaves of PV, one at a time, as long as they pay."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from compiled import kernel
from estimator.algebra import dot, filter_rows, orthonormal, project_out
from estimator.arrays import Array
from estimator.hypotheses.hypothesis import Case, Hypothesis, likelier
from estimator.hypotheses.linear_fit import delay
from estimator.hypotheses.noise import DRIFT, DRIFT_AND_NOISE
from estimator.hypotheses.nuisances import (
    FEWEST_CYCLES,
    Characteristic,
    Nuisance,
    Sinusoid,
    sine_and_cosine,
    spectral_peaks,
)
from estimator.search.processes import polish

__all__ = ["add_best", "fit_repeating", "fit_waves"]

_STEPS = (0.4, 0.2, 0.1, 0.05)
"""Cycles by which a frequency is moved while it is refined."""
_SHARP_STEPS = (0.03, 0.015, 0.007)
"""The same for a wave with harmonics."""
_ROUGH_STEPS = (0.1, 0.05)
"""The same before it where the frequency is only that of a peak."""
_RESOLVED = 0.4
"""Highest frequency of a harmonic over the sampling frequency; one half is the limit (Nyquist)."""
_SHARPENED, _FOLLOWED = 3, 2
"""Waves of PV's own oscillation, of five, whose frequency is refined, and whose process then is
fitted once more."""
_ORDERS = (6, 10, 16)
"""Highest harmonics of a wave of any shape, of which the likeliest is taken: what a saw-tooth or a
wave with rests leaves beside them is as small as the noise."""
_MORE = 100.0
"""Nats by which the first order may be further behind than the best one: of simulated healthy
valves that a higher order clears, it is at most 153 behind the sticky one, 250 are allowed."""
_REPEATED = 3.0
"""Cycles below which such a wave is not looked for: of fewer, all of PV repeats itself."""
_HOPE = 3.0
"""Nats a harmonic by which a wave may be behind before its frequency is sharpened."""


def add_best(case: Case, of: Hypothesis, other: Hypothesis) -> Hypothesis | None:
    """The hypothesis with the one nuisance more that makes it likeliest; None where none is left.

    Frequencies are looked for in what it leaves, whitened and not, and in what ``other`` leaves.
    """
    found: list[Hypothesis] = []

    def tried(nuisance: Nuisance, taps: Array | None = None) -> Hypothesis:
        return _with(case, of, (*of.nuisances, nuisance), taps)

    waves = [one for one in of.nuisances if isinstance(one, Sinusoid)]
    if len(waves) < case.settings.modelling.max_sinusoids:
        cycles = _frequency(case, of, other)
        if cycles is not None:
            for wave in _waves_of(case, cycles):
                found.append(_sharpened(tried, wave, of.likelihood))
    if not any(isinstance(one, Characteristic) for one in of.nuisances):
        found.append(tried(Characteristic()))
    return max(found, key=lambda one: one.likelihood, default=None)


def fit_waves(case: Case, healthy: Hypothesis) -> Hypothesis | None:
    """The healthy valve with PV's own oscillation from outside, its process fitted again with it.

    In a closed loop a process that was fitted first takes the disturbance for its own work: what it
    leaves shows no peak, and the right process lies behind a ridge. None where PV does not
    oscillate.
    """
    cycles = case.own_cycles
    if cycles is None:
        return None
    simple, *shaped = _waves_of(case, cycles)

    def start(wave: Sinusoid, taps: Array) -> tuple[Hypothesis, Sinusoid]:
        return polish(case, None, healthy, (wave,), taps, passes=1), wave

    noises = DRIFT, DRIFT_AND_NOISE
    starts = [start(simple, taps) for taps in noises]
    first, second = (one for one, _ in starts)
    likely = noises[0 if likelier(first, second) is first else 1]
    starts += [start(wave, likely) for wave in shaped]
    starts.sort(key=lambda one: -round(one[0].likelihood, 6))
    found = []
    for at, wave in starts[:_SHARPENED]:

        def tried(nuisance: Nuisance, taps: Array | None = None, at: Hypothesis = at) -> Hypothesis:
            return _with(case, at, (nuisance,), taps)

        found.append(_sharpened(tried, wave, starts[0][0].likelihood, _ROUGH_STEPS))
    found.sort(key=lambda one: -round(one.likelihood, 6))
    ends = [polish(case, None, one, one.nuisances, one.taps) for one in found[:_FOLLOWED]]
    return max(ends, key=lambda one: one.likelihood)


def fit_repeating(case: Case, healthy: Hypothesis, least: float) -> Hypothesis | None:
    """The healthy valve with PV's own oscillation from outside, of any shape, wherever it enters.

    Every harmonic has a size of its own, up to one of several orders. None where PV does not
    oscillate, or where that is not as likely as ``least`` before its process is fitted.
    """
    cycles = case.own_cycles
    if cycles is None or cycles < _REPEATED:
        return None

    def tried(nuisance: Nuisance, taps: Array | None = None) -> Hypothesis:
        return _with(case, healthy, (nuisance,), taps)

    most = _RESOLVED * case.rows.size / cycles
    best: Hypothesis | None = None
    rough: tuple[float, ...] = _ROUGH_STEPS
    for order in _ORDERS:
        if order > most:
            break
        wave = Sinusoid(cycles, tuple(range(1, order + 1)))
        found = _sharpened(tried, wave, -math.inf, rough)
        cycles, rough = found.waves[0].cycles, ()
        best = found if best is None else likelier(best, found)
        if best.likelihood < least - _MORE:
            return None
    if best is None or best.likelihood < least:
        return None
    return polish(case, None, best, best.nuisances, best.taps)


def _waves_of(case: Case, cycles: float) -> list[Sinusoid]:
    """The waves that are offered at a frequency: all of whose harmonics the samples resolve."""
    most = max(1.0, _RESOLVED * case.rows.size / cycles)
    waves = case.settings.modelling.waves
    return [Sinusoid(cycles, harmonics) for harmonics in waves if max(harmonics) <= most]


def _with(
    case: Case, of: Hypothesis, nuisances: tuple[Nuisance, ...], taps: Array | None
) -> Hypothesis:
    """The hypothesis with other nuisances: its noise model fitted again, or ``taps`` kept."""
    return case.fit(
        of.valve,
        of.poles,
        of.dead_time,
        nuisances,
        of.taps if taps is None else taps,
        refit_noise=taps is None,
        stem=of.stem,
    )


def _sharpened(
    tried: Callable[..., Hypothesis],
    wave: Sinusoid,
    least: float,
    rough: tuple[float, ...] = (),
) -> Hypothesis:
    """Return the hypothesis with the wave at its best frequency, refined with its harmonics.

    ``tried`` fits a wave, under a given noise model or with its own. ``rough`` steps (cycles) come
    first where the frequency is only that of a peak.
    """
    best = tried(wave)
    harmonics = len(wave.harmonics)
    if best.likelihood < least - _HOPE * harmonics or (harmonics == 1 and not rough):
        return best
    cycles, held = wave.cycles, best
    for step in (*rough, *_SHARP_STEPS):
        for moved in (cycles - step, cycles + step):
            # the noise model is held: what is compared are frequencies
            found = tried(Sinusoid(moved, wave.harmonics), best.taps)
            if found.likelihood > held.likelihood:
                held, cycles = found, moved
                break
    found = best if held is best else tried(Sinusoid(cycles, wave.harmonics))
    return found if found.likelihood > best.likelihood else best


def _frequency(case: Case, of: Hypothesis, other: Hypothesis) -> float | None:
    """The frequency (cycles in the window) of the sinusoid that takes most away."""
    rows = case.rows
    none = np.zeros(0)
    whitened = filter_rows(of.residual[None], of.taps, rows.weight)[0]
    response = of.poles.response(of.stem)
    known = np.vstack(
        [
            case.columns(of.nuisances, of.stem, of.poles, of.dead_time),
            delay(response, of.dead_time)[None],
        ]
    )
    best, found = 0.0, None
    seeds = (
        (none, [*spectral_peaks(of.residual, 2), *spectral_peaks(other.residual, 1)]),
        (of.taps, spectral_peaks(whitened, 2)),
    )
    for taps, peaks in seeds:
        basis = orthonormal(filter_rows(known, taps, rows.weight))
        left = project_out(filter_rows(of.residual[None], taps, rows.weight)[0], basis)
        whole = dot(left, left)

        for peak in peaks:
            if peak < FEWEST_CYCLES:
                continue
            cycles, taken = _best_cycles(peak, np.array(_STEPS), taps, rows.weight, basis, left)
            # the share of what was left that it explains, in nats
            nats = -0.5 * rows.count * math.log(max(1e-12, 1.0 - taken / whole)) if whole else 0.0
            if nats > best:
                best, found = nats, cycles
    return found


@kernel
def _best_cycles(
    peak: float, steps: Array, taps: Array, weight: Array, basis: Array, left: Array
) -> tuple[float, float]:
    """Cycles near a peak of the sinusoid that takes most away, and the sum of squares it takes.

    Of what an orthonormal ``basis`` ``(m, n)`` leaves of the residual, ``left`` ``(n,)``, both
    under the noise model of ``taps``; the frequency moves by each of the ``steps`` in turn.
    """
    cycles, most = peak, _taken(peak, taps, weight, basis, left)
    for step in steps:
        below, above = cycles - step, cycles + step
        for moved in (below, above):
            more = _taken(moved, taps, weight, basis, left)
            if more > most:
                cycles, most = moved, more
    return cycles, most


@kernel
def _taken(cycles: float, taps: Array, weight: Array, basis: Array, left: Array) -> float:
    """Sum of squares that one sinusoid takes away; see `_best_cycles`."""
    wave = filter_rows(sine_and_cosine(cycles, left.size), taps, weight)
    for r in range(2):
        wave[r] = project_out(wave[r], basis)
    mine = orthonormal(wave)
    total = 0.0
    for r in range(mine.shape[0]):
        total += dot(mine[r], left) ** 2
    return total
