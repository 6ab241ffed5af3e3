"""Oscillations of known period in noise and drift, and signals that do not oscillate."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from estimator.diagnosis.oscillation import detect_oscillations
from fieldlink.diagnosis import detect_oscillation

RECORDED = Path(__file__).resolve().parents[3] / "shared" / "data" / "oscillation"


@pytest.mark.parametrize("cycle", [13.0, 61.0, 190.0])
@pytest.mark.parametrize("shape", [np.sin, lambda x: np.sign(np.sin(x))])
def test_the_period_is_found_through_noise_and_drift(cycle: float, shape) -> None:
    rng = np.random.default_rng(3)
    k = np.arange(2000)
    drift = 0.05 * np.cumsum(rng.standard_normal(k.size))
    wave = shape(2.0 * np.pi * k / cycle)
    found = detect_oscillation(wave + 0.4 * rng.standard_normal(k.size) + drift, period=2.0)
    assert found.present
    assert found.period_s == pytest.approx(2.0 * cycle, rel=0.05)
    assert found.regularity > 1.0
    assert found.amplitude == pytest.approx(1.0, rel=0.35)


def test_white_noise_as_strong_as_a_wave_does_not_hide_it() -> None:
    found = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        wave = np.sin(2.0 * np.pi * np.arange(1000) / 45.0)
        found.append(detect_oscillation(wave + rng.standard_normal(wave.size)))
    assert sum(one.present for one in found) >= 18
    near = [abs(one.period_s / 45.0 - 1.0) < 0.05 for one in found if one.present]
    assert np.mean(near) >= 0.9


def test_bad_samples_are_bridged() -> None:
    k = np.arange(1500)
    values = np.sin(2.0 * np.pi * k / 40.0)
    values[200:230] = np.nan
    assert detect_oscillation(values).period_s == pytest.approx(40.0, rel=0.02)


def test_noise_and_walks_seldom_oscillate() -> None:
    rng = np.random.default_rng(0)
    white = rng.standard_normal((60, 1000))
    walks = np.cumsum(rng.standard_normal((60, 1000)), axis=1)
    assert sum(detect_oscillation(row).present for row in white) <= 1
    assert sum(detect_oscillation(row).present for row in walks) <= 8


@pytest.mark.parametrize("damping", [0.5, 0.6])
def test_noise_behind_a_well_damped_resonance_seldom_oscillates(damping: float) -> None:
    turn = 2.0 * np.pi / 40.0
    size = np.exp(-damping * turn)
    poles = [1.0, -2.0 * size * np.cos(turn * np.sqrt(1.0 - damping**2)), size**2]
    found = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        found += detect_oscillation(lfilter([1.0], poles, rng.standard_normal(3000))[1000:]).present
    assert found <= 8


@pytest.mark.parametrize("seed", range(6))
def test_pulses_oscillate_with_the_period_between_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    at = np.cumsum(np.round(60.0 * (1.0 + 0.01 * rng.standard_normal(30)))).astype(int)
    pulses = np.zeros(1800)
    for one in at[at < 1790]:
        pulses[one : one + 6] += rng.uniform(0.6, 1.4)
    found = detect_oscillation(pulses + 0.1 * rng.standard_normal(pulses.size))
    assert found.present
    assert found.period_s == pytest.approx(60.0, rel=0.05)


@pytest.mark.parametrize("seed", range(6))
def test_pulses_at_random_times_do_not_oscillate(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pulses = np.zeros(1800)
    for one in rng.integers(0, 1790, 30):
        pulses[one : one + 6] += rng.uniform(0.6, 1.4)
    assert not detect_oscillation(pulses + 0.1 * rng.standard_normal(pulses.size)).present


@pytest.mark.parametrize("multiple", [5, 7])
def test_a_far_smaller_slow_wave_is_no_fundamental_of_a_large_one(multiple: int) -> None:
    # by chance three slower waves in ten have such a ratio
    k = np.arange(3600)
    noise = 0.1 * np.random.default_rng(multiple).standard_normal(k.size)
    large, small = (np.sin(2.0 * np.pi * k / cycle) for cycle in (20.0, 20.0 * multiple))
    found = detect_oscillations(10.0 * large + small + noise)
    assert sum(one.present for one in found) >= 2, "the slow one is seen"
    assert found[0].period_s == pytest.approx(20.0, rel=0.01)


def test_a_constant_has_no_oscillation() -> None:
    assert not detect_oscillation(np.full(500, 3.0)).present


@pytest.mark.skipif(not RECORDED.is_dir(), reason=f"{RECORDED} is absent")
def test_recorded_labels_agree_for_most_loops() -> None:
    labels = list(
        csv.DictReader((RECORDED.parent / "oscillation_labels.csv").read_text().splitlines())
    )
    agree = 0
    for row in labels:
        op = np.genfromtxt(RECORDED / row["file"], skip_header=1)
        found = detect_oscillation(op, period=float(row["period_s"]))
        agree += found.present == (row["oscillating"] == "1")
    assert agree >= 40, f"{agree} of {len(labels)}"
