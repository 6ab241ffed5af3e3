"""A wave of steady strength and a resonance that noise keeps going."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from benchmarks.diagnosis_families.tuning import singles
from benchmarks.diagnosis_families.tuning.singles import draw_loop
from estimator.diagnosis.amplitude import amplitude_variation
from fieldlink.diagnosis import diagnose

RAYLEIGH = np.sqrt(4.0 / np.pi - 1.0)
"""Deviation over mean of Rayleigh's distribution."""


def test_a_sine_has_one_amplitude_and_a_resonance_in_noise_rayleighs() -> None:
    k, noise = np.arange(20_000), np.random.default_rng(1)
    sine = np.sin(2.0 * np.pi * k / 40.0) + 0.05 * noise.standard_normal(k.size)
    assert amplitude_variation(sine, 40.0, 0.2) < 0.05
    pole = 0.98 * np.exp(2j * np.pi / 40.0)
    resonance = lfilter([1.0], np.poly([pole, np.conj(pole)]), noise.standard_normal(k.size))
    assert amplitude_variation(resonance, 40.0, 0.2) == pytest.approx(RAYLEIGH, abs=0.1)


@pytest.mark.parametrize("seed", [73000, 73001, 73010])
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
