"""Spikes and a frozen value are not samples of PV: they accuse no valve, and hide none."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from benchmarks.families.tuning import draw
from estimator import ReasonCode, Verdict, identify
from estimator.arrays import Array
from estimator.faults import faults_of
from estimator.settings import SETTINGS
from tests.closed_loop import run
from tests.seeds import few_and_all, in_suite

SEEDS = range(20)
K = np.arange(900.0)


def _faults(pv: Array) -> list[int]:
    return np.flatnonzero(faults_of(pv, SETTINGS.screening)).tolist()


def _coloured(seed: int, pole: float) -> Array:
    rng = np.random.default_rng(seed)
    x = np.zeros(K.size)
    for k in range(1, K.size):
        x[k] = pole * x[k - 1] + rng.normal()
    return x


@pytest.mark.parametrize("pole", [0.0, 0.7, 0.95, 0.999])
def test_noise_has_no_faults(pole: float) -> None:
    for seed in SEEDS:
        assert _faults(_coloured(seed, pole)) == []


@pytest.mark.parametrize("period", [9.0, 24.0, 60.0, 400.0])
def test_waves_without_noise_have_no_faults(period: float) -> None:
    turn = 2.0 * np.pi * K / period
    for wave in (np.sin(turn), np.arcsin(np.sin(turn)), np.sign(np.sin(turn)), turn % (2 * np.pi)):
        assert _faults(wave) == []


@pytest.mark.parametrize("step", [0.02, 0.2, 0.8])
def test_rounding_and_holding_make_no_faults(step: float) -> None:
    for seed in SEEDS:
        signal = 10.0 * np.sin(2.0 * np.pi * K / 300.0) + 0.1 * _coloured(seed, 0.8)
        assert _faults(np.round(signal / step) * step) == []
        assert _faults(np.repeat(signal[::6], 6)) == []
        stored, last = np.empty(K.size), signal[0]
        for k in range(K.size):
            last = signal[k] if abs(signal[k] - last) > step else last
            stored[k] = last
        assert _faults(stored) == []


def test_every_spike_is_found_and_a_step_is_none() -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        pv = np.sin(2.0 * np.pi * K / 80.0) + 0.05 * rng.normal(size=K.size)
        pv[450:] += 3.0
        at = np.sort(rng.choice(np.arange(20, 880, 20), 8, replace=False))
        pv[at] += rng.choice([-1.0, 1.0], 8) * rng.uniform(2.0, 30.0, 8)
        assert _faults(pv) == at.tolist()
        # two samples long, and beside a missing one
        pv[at[0] + 1] = pv[at[0]]
        pv[at[1] + 1] = np.nan
        assert _faults(pv) == sorted([*at.tolist(), int(at[0]) + 1])


def test_spikes_that_are_close_to_each_other_are_found() -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        pv = np.sin(2.0 * np.pi * K / 80.0) + 0.05 * rng.normal(size=K.size)
        begin = int(rng.integers(50, 800))
        at = [begin, begin + 3, begin + 4]
        pv[at] += 6.0
        assert _faults(pv) == at


def test_spikes_that_are_close_to_each_other_accuse_no_valve() -> None:
    loop = draw("spikes", False, 80030)
    assert identify(loop.op, loop.pv, sp=loop.sp).verdict is not Verdict.STICTION


@pytest.mark.parametrize("long", [10, 40, 300])
def test_a_value_that_stands_still_is_found(long: int) -> None:
    for seed in SEEDS:
        pv = _coloured(seed, 0.8)
        pv[200 : 201 + long] = pv[200]
        assert _faults(pv) == list(range(201, 201 + long))


def test_a_rounded_value_that_stands_still_is_found_by_its_jump() -> None:
    pv = np.round(10.0 * np.sin(2.0 * np.pi * K / 300.0), 0)
    pv[148:280] = 0.0  # as at 148; it goes on at -4
    assert _faults(pv) == list(range(149, 280))


@pytest.mark.parametrize("mark", [-9999.0, 0.0, 1e10])
def test_a_number_that_stands_for_none_is_found(mark: float) -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        pv = 50.0 + 0.1 * _coloured(seed, 0.9)
        at = np.sort(rng.choice(K.size, 5, replace=False))
        for one in at:
            pv[one : one + 30] = mark
        assert _faults(pv) == np.flatnonzero(pv == mark).tolist()


def test_two_positions_and_a_step_are_no_marks() -> None:
    for seed in SEEDS:
        assert _faults(np.where(_coloured(seed, 0.95) > 0.0, 80.0, 20.0)) == []
        pv = 0.05 * np.random.default_rng(seed).normal(size=K.size)
        pv[400:] += 30.0
        assert _faults(pv) == []


def _spiked(seed: int, size: float) -> Array:
    rng = np.random.default_rng(seed)
    added = np.zeros(1500)
    added[rng.choice(np.arange(40, 1460, 10), 8, replace=False)] = size * rng.choice([-1.0, 1.0], 8)
    return added


@pytest.mark.parametrize("size", in_suite(1, [8.0, 1.5]))
@pytest.mark.parametrize("seeds", few_and_all(4, range(10)))
def test_spikes_that_the_controller_answers_accuse_no_valve(
    size: float, seeds: Sequence[int]
) -> None:
    # without this 3 and 10 of the 10 are called sticky with certainty
    for seed in seeds:
        loop = run(seed=seed, faults=_spiked(seed, size))
        found = identify(loop.op, loop.pv)
        assert found.verdict is not Verdict.STICTION
        assert "in 8 samples: these are left out" in str(found.reasons[-1])


@pytest.mark.parametrize("seeds", few_and_all(3, range(10)))
def test_spikes_hide_no_valve(seeds: Sequence[int]) -> None:
    for seed in seeds:
        loop = run(seed=seed, band=4.0, jump=2.0, faults=_spiked(seed, 8.0))
        found = identify(loop.op, loop.pv)
        assert found.verdict is Verdict.STICTION
        assert found.stick_band.low <= 4.0 <= found.stick_band.high


@pytest.mark.parametrize("sticky", in_suite(1, [True, False]))
@pytest.mark.parametrize("seeds", few_and_all(3, range(10)))
def test_a_transmitter_that_froze_is_left_out(sticky: bool, seeds: Sequence[int]) -> None:
    for seed in seeds:
        added = np.zeros(1500)
        added[300 + 40 * seed : 420 + 40 * seed] = np.nan
        loop = run(seed=seed, band=4.0 * sticky, jump=2.0 * sticky, faults=added)
        found = identify(loop.op, loop.pv)
        assert (found.verdict is Verdict.STICTION) == sticky
        assert found.reasons[-1].code is ReasonCode.PV_FAULTS


def test_a_window_that_is_frozen_for_a_third_is_not_judged() -> None:
    added = np.zeros(1500)
    added[500:1000] = np.nan
    loop = run(faults=added)
    found = identify(loop.op, loop.pv)
    assert found.verdict is Verdict.NOT_ASSESSABLE
    assert found.reasons[0].code is ReasonCode.PV_FAULTS
    assert "leaves 1000 of 1500 samples" in str(found.reasons[0])
