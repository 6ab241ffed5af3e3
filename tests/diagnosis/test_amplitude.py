"""A wave of steady strength and a resonance that noise keeps going."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from benchmarks.diagnosis_families.tuning import singles
from benchmarks.diagnosis_families.tuning.singles import draw_loop
from estimator.diagnosis.amplitude import (
    amplitudes_of,
    evidence_against_noise,
    phase_kept_by,
    swing_amplitude,
    variation_of,
)
from estimator.diagnosis.coherence import LoopSignals, LoopSpectrum, spectrum_of
from estimator.diagnosis.gather import find_swing
from estimator.diagnosis.loop_record import loop_record
from estimator.diagnosis.settings import DIAGNOSIS
from fieldlink.diagnosis import diagnose
from tests.seeds import in_suite

RAYLEIGH = np.sqrt(4.0 / np.pi - 1.0)
"""Deviation over mean of Rayleigh's distribution."""


def spectrum(signal: np.ndarray) -> LoopSpectrum:
    return spectrum_of(LoopSignals(signal, None, None, 1.0))


def resonance(size: int, seed: int) -> np.ndarray:
    pole = 0.98 * np.exp(2j * np.pi / 40.0)
    noise = np.random.default_rng(seed).standard_normal(size)
    return np.asarray(lfilter([1.0], np.poly([pole, np.conj(pole)]).real, noise))


def test_a_sine_has_one_amplitude_and_a_resonance_in_noise_rayleighs() -> None:
    k, noise = np.arange(20_000), np.random.default_rng(1)
    sine = np.sin(2.0 * np.pi * k / 40.0) + 0.05 * noise.standard_normal(k.size)
    assert variation_of(spectrum(sine), 40.0, 0.2) < 0.05
    found = variation_of(spectrum(resonance(k.size, 1)), 40.0, 0.2)
    assert found == pytest.approx(RAYLEIGH, abs=0.1)


def test_a_machine_whose_size_changes_keeps_its_phase_and_noise_does_not() -> None:
    k = np.arange(3000)
    size = 1.0 + 0.5 * np.sin(2.0 * np.pi * k / 900.0)
    machine = spectrum(size * np.sin(2.0 * np.pi * k / 41.0 + 0.7))
    assert variation_of(machine, 40.0, 0.2) > 0.26
    assert phase_kept_by(amplitudes_of(machine, 40.0, 0.2)) > 0.98
    noisy = [amplitudes_of(spectrum(resonance(k.size, seed)), 40.0, 0.2) for seed in range(8)]
    assert max(map(phase_kept_by, noisy)) < 0.98


@pytest.mark.parametrize("seed", in_suite(2, [73001, 73010, 73000]))
def test_a_swing_that_outlasts_the_record_is_no_wave_for_its_steadiness(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoil = singles.spoil_tuning
    monkeypatch.setattr(
        singles, "spoil_tuning", lambda loop, rng, how: spoil(loop, rng, how, (1.003, 1.02))
    )
    loop = draw_loop(("tight_tuning",), seed)
    answer = diagnose(loop.op, loop.pv, loop.sp, period=loop.period, advice=False)
    assert answer.first.name != "external_oscillation"


def places_apart(signal: LoopSpectrum) -> int:
    times, _ = signal.amplitudes(1.0 / 40.0, 0.2 / 40.0)
    return round(0.5 * 40.0 / 0.2 / (times[1] - times[0]))


def against_noise(signal: np.ndarray, **more: bool) -> float:
    found = spectrum(signal)
    return evidence_against_noise(amplitudes_of(found, 40.0, 0.2), places_apart(found), **more)


def test_noise_changes_size_and_phase_alike_and_a_machine_one_of_them() -> None:
    k = np.arange(4000)
    noise = np.random.default_rng(3)
    slow = lfilter([1.0], [1.0, -0.99], noise.standard_normal(k.size))
    slow = slow / slow.std()
    floor = 0.1 * noise.standard_normal(k.size)
    of_load = (1.0 + 0.3 * slow) * np.sin(2.0 * np.pi * k / 40.0) + floor
    of_speed = np.sin(2.0 * np.pi * k / 40.0 + 0.7 * slow) + floor
    assert against_noise(of_load) > 10.0
    assert against_noise(of_speed) > 10.0
    assert max(against_noise(resonance(k.size, seed)) for seed in range(20)) < 10.0


def test_beside_steps_of_the_set_point_a_size_that_changes_is_no_evidence() -> None:
    # a resonance that nothing but steps excites dies along itself after each of them
    steps = np.zeros(4000)
    steps[::400] = 1.0
    pole = 0.98 * np.exp(2j * np.pi / 40.0)
    rings = np.asarray(lfilter([1.0], np.poly([pole, np.conj(pole)]).real, steps))
    rings += 0.01 * rings.std() * np.random.default_rng(1).standard_normal(steps.size)
    assert against_noise(rings) > 10.0
    assert against_noise(rings, stepped=True) == 0.0


def amplitude_of(pv: np.ndarray) -> tuple[float, float, float]:
    record = loop_record(np.zeros(pv.size), pv, None, None, 1.0)
    swing, _ = find_swing(record, DIAGNOSIS)
    assert swing.present
    return swing_amplitude(record, swing, DIAGNOSIS)


def test_a_neighbour_whose_period_changes_every_few_swings_is_no_noise() -> None:
    # its size never changes; a narrow band about the mean period makes it seem to
    noise = np.random.default_rng(5)
    course = lfilter([1.0], [1.0, -np.exp(-1.0 / 120.0)], noise.standard_normal(2000))
    phase = np.cumsum(2.0 * np.pi / 40.0 * (1.0 + 0.1 * course / course.std()))
    pv = np.sin(phase) + 0.05 * noise.standard_normal(phase.size)
    narrow = amplitudes_of(spectrum(pv), 40.0, DIAGNOSIS.grouping.width)
    assert evidence_against_noise(narrow, places_apart(spectrum(pv))) < 10.0
    variation, _, unlike = amplitude_of(pv)
    assert variation < 0.26
    assert unlike > 10.0
    assert max(amplitude_of(resonance(2000, seed))[2] for seed in range(20)) < 10.0
