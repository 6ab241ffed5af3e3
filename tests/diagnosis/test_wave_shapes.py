"""Waves from outside that are no sine, and those whose size changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.diagnosis.explanations import explain
from fieldlink.diagnosis import CauseName, Diagnosis, diagnose
from tests.closed_loop import Loop, run
from tests.seeds import few_and_all

K = np.arange(1500)


def found(loop: Loop) -> Diagnosis:
    return diagnose(loop.op, loop.pv, loop.sp, period=1.0, advice=False)


def drift(seed: int, pole: float, samples: int = K.size) -> NDArray[np.float64]:
    moves = np.random.default_rng(seed).standard_normal(samples)
    load = np.zeros(samples)
    for k in range(1, load.size):
        load[k] = pole * load[k - 1] + moves[k]
    return np.asarray(load / load.std())


def test_a_train_of_pulses_comes_from_outside_though_noise_moves_its_crossings() -> None:
    pulses = 4.0 * ((K / 40.0 % 1.0 < 0.25) - 0.25)
    answer = found(run(load=pulses + drift(5, 0.98), seed=5))
    assert answer.oscillation.regularity < 6.7
    assert answer.first.name == "external_oscillation"


def test_a_wave_whose_size_changes_is_no_tight_tuning() -> None:
    wave = 5.0 * np.sin(2.0 * np.pi * K / 50.0) * (1.0 + 0.4 * drift(2, 0.99))
    answer = found(run(load=wave, gain=0.25, integral_time=7.0, lag=6.0, dead=8, seed=2))
    assert answer.first.name == "external_oscillation"


@pytest.mark.parametrize("seeds", few_and_all(2, range(4)))
def test_a_machine_whose_load_changes_all_the_time_is_no_tight_tuning(
    seeds: Sequence[int],
) -> None:
    named = []
    for seed in seeds:
        k = np.arange(2400)
        size = 1.0 + 0.45 * drift(seed, 0.99, k.size)
        wave = 4.0 * size * np.sin(2.0 * np.pi * k / 30.0)
        answer = found(run(load=wave, gain=1.2, n=k.size, seed=seed))
        named.append(answer.first.name)
    assert named.count(CauseName.EXTERNAL_OSCILLATION) >= 0.75 * len(seeds)
    assert CauseName.TIGHT_TUNING not in named


def test_an_undetermined_oscillation_says_what_does_not_show() -> None:
    # a slow controller, much noise: PV is not seen to follow OP
    wave = 3.0 * ((K[:600] / 60.0 + 0.1 * drift(10, 0.98, 600)) % 1.0 - 0.5)
    load = wave + 1.2 * drift(60, 0.98, 600)
    answer = found(run(load=load, gain=0.1, noise=0.3, n=600, seed=10))
    assert answer.first.name == "undetermined"
    assert answer.oscillation.present
    assert not any("tight loop" in sentence for sentence in answer.first.evidence)


def test_the_shape_of_a_fast_wave_counts() -> None:
    # eleven samples: the third harmonic has fewer than four of its own
    phase = K / 11.0 % 1.0
    wave = np.where(phase < 0.25, phase / 0.25, (1.0 - phase) / 0.75) - 0.5
    for seed in (3, 4, 5):
        load = 12.0 * wave + 0.3 * drift(seed, 0.9)
        loop = run(load=load, gain=1.2, integral_time=7.0, lag=5.0, dead=1, noise=0.1, seed=seed)
        explained = explain(
            loop.op, loop.pv, loop.sp, None, 1.0, K.size / 11.0, late=1, valve_is_healthy=True
        )
        assert explained.outside > 120.0
