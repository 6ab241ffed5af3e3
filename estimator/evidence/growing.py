"""Nuisances found in what a hypothesis leaves of PV, one at a time, as long as they pay."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from estimator.criteria.design import delay
from estimator.evidence.hypothesis import Case, Hypothesis
from estimator.evidence.nuisances import Characteristic, Nuisance, Sinusoid
from estimator.lanes import Array, dot, filter_rows, orthonormal, project_out

__all__ = ["add_best", "spectral_peaks"]

_FEWEST_CYCLES = 1.5
"""An oscillation of fewer cycles in the window is a drift."""
_STEPS = (0.4, 0.2, 0.1, 0.05)
"""Cycles by which a frequency is moved while it is refined."""
_SHARP_STEPS = (0.03, 0.015, 0.007)
"""The same for a wave with harmonics."""
_HOPE = 8.0
"""Nats a harmonic by which a wave may be behind before its frequency is sharpened."""
_NEAR = 3
"""Bins of a spectrum that one peak takes."""


def spectral_peaks(signal: Array, count: int) -> list[float]:
    """Cycles in the window of the highest peaks of the spectrum, Hann window, interpolated."""
    n = signal.size
    centred = signal - dot(signal, np.ones(n)) / n
    spectrum = np.abs(np.fft.rfft(centred * np.hanning(n)))
    found = []
    for _ in range(count):
        k = 1 + int(spectrum[1:-1].argmax())
        left, middle, right = (float(spectrum[i]) for i in (k - 1, k, k + 1))
        bend = left - 2.0 * middle + right
        found.append(k + (0.5 * (left - right) / bend if bend < 0.0 else 0.0))
        spectrum[max(0, k - _NEAR) : k + _NEAR + 1] = 0.0
    return found


def add_best(case: Case, of: Hypothesis, other: Hypothesis) -> Hypothesis | None:
    """The hypothesis with the one nuisance more that makes it likeliest; None where none is left.

    Frequencies are looked for in what it leaves, whitened and not, and in what ``other`` leaves.
    """
    found: list[Hypothesis] = []

    def tried(nuisance: Nuisance) -> Hypothesis:
        return case.fit(
            of.valve, of.poles, of.dead_time, (*of.nuisances, nuisance), of.taps, stem=of.stem
        )

    waves = [one for one in of.nuisances if isinstance(one, Sinusoid)]
    if len(waves) < case.settings.modelling.max_sinusoids:
        cycles = _frequency(case, of, other)
        if cycles is not None:
            most = 0.25 * case.rows.size / cycles
            for harmonics in case.settings.modelling.waves:
                if max(harmonics) <= max(1.0, most):
                    found.append(_sharpened(tried, Sinusoid(cycles, harmonics), of.likelihood))
    if not any(isinstance(one, Characteristic) for one in of.nuisances):
        found.append(tried(Characteristic()))
    return max(found, key=lambda one: one.likelihood, default=None)


def _sharpened(tried: Callable[[Nuisance], Hypothesis], wave: Sinusoid, least: float) -> Hypothesis:
    """The hypothesis with the wave at its best frequency: harmonics tell it sharper than a sine."""
    best = tried(wave)
    if len(wave.harmonics) == 1 or best.likelihood < least - _HOPE * len(wave.harmonics):
        return best
    cycles = wave.cycles
    for step in _SHARP_STEPS:
        for moved in (cycles - step, cycles + step):
            found = tried(Sinusoid(moved, wave.harmonics))
            if found.likelihood > best.likelihood:
                best, cycles = found, moved
    return best


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

        def gain(
            cycles: float, taps: Array = taps, basis: Array = basis, left: Array = left
        ) -> float:
            wave = Sinusoid(cycles).columns(of.stem, of.poles, of.dead_time)
            mine = filter_rows(wave, taps, rows.weight)
            mine = orthonormal(np.stack([project_out(row, basis) for row in mine]))
            return float(sum(dot(row, left) ** 2 for row in mine))

        for peak in peaks:
            if peak < _FEWEST_CYCLES:
                continue
            cycles, least = peak, gain(peak)
            for step in _STEPS:
                for moved in (cycles - step, cycles + step):
                    more = gain(moved)
                    if more > least:
                        cycles, least = moved, more
            # the share of what was left that it explains, in nats
            nats = -0.5 * rows.count * math.log(max(1e-12, 1.0 - least / whole)) if whole else 0.0
            if nats > best:
                best, found = nats, cycles
    return found
