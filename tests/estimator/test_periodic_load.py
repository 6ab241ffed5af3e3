"""A load that goes up and down along lines, or on and off, is not taken for a sticky valve."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter, sawtooth

from estimator import Verdict, identify
from estimator.evidence.periodic_loads import fit_periodic_load
from estimator.hypotheses.periodic_load import PeriodicLoad
from estimator.processes.poles import Poles, Shape
from tests.closed_loop import run

LAG = Poles(Shape.LAGS, 6.0)


@pytest.mark.parametrize(("begin", "rise"), [(0.0, 0.5), (0.3, 0.2), (0.9, 0.8)])
def test_its_column_is_the_response_to_a_triangular_wave(begin: float, rise: float) -> None:
    n, cycles = 500, 7.3
    wave = sawtooth(2.0 * np.pi * (cycles * np.arange(n) / n + begin), rise)
    pole = np.exp(-1.0 / 6.0)
    expected = lfilter([1.0 - pole], [1.0, -pole], wave - wave[0])
    column = PeriodicLoad(cycles, begin, rise, LAG).columns(np.zeros(n), LAG, 0)
    np.testing.assert_allclose(column[0], expected, atol=1e-9)


@pytest.mark.parametrize(("begin", "high"), [(0.0, 0.5), (0.3, 0.2), (0.9, 0.8)])
def test_the_column_of_a_rectangular_one_is_the_response_to_its_mean(
    begin: float, high: float
) -> None:
    n, cycles, fine = 400, 7.3, 500
    at = (np.arange((n - 1) * fine) + 0.5) / fine * cycles / n + begin
    means = np.where(at % 1.0 < high, 1.0, -1.0).reshape(n - 1, fine).mean(axis=1)
    pole = np.exp(-1.0 / 6.0)
    column = PeriodicLoad(cycles, begin, high, LAG, square=True).columns(np.zeros(n), LAG, 0)[0]
    # one sample is the one before, decayed, and what the load's mean between them adds
    base = (column[1:] - pole * column[:-1]) / (1.0 - pole)
    np.testing.assert_allclose(base - base[0], means - means[0], atol=5.0 / fine)


@pytest.mark.parametrize(
    ("period", "high", "gain", "seed"), [(60, 0.5, 0.6, 0), (150, 0.4, 0.6, 3)]
)
def test_a_healthy_valve_under_a_rectangular_one_is_not_accused(
    period: int, high: float, gain: float, seed: int
) -> None:
    load = 3.0 * np.where((np.arange(700) / period + 0.17 * seed) % 1.0 < high, 1.0, -1.0)
    record = run(load=load, n=700, dead=2, noise=0.03, seed=seed, gain=gain)
    result = identify(record.op, record.pv, sp=record.sp)
    assert result.verdict is Verdict.NO_STICTION
    assert not result.uncertain


@pytest.mark.parametrize(("noise", "seed"), [(0.02, 5), (0.03, 4)])
def test_a_sticky_stem_is_not_taken_for_a_rectangular_load(noise: float, seed: int) -> None:
    # PV moves as under such a load: OP swings little wider than the stick band
    record = run(n=500, band=5.0, jump=2.0, noise=noise, seed=seed)
    assert np.ptp(record.op) < 1.6 * 5.0
    result = identify(record.op, record.pv, sp=record.sp)
    assert result.verdict is Verdict.STICTION
    assert not result.uncertain


@pytest.mark.parametrize("rise", [0.15, 0.5, 0.7])
def test_it_is_found_with_the_process_that_it_goes_through(case, rise: float) -> None:
    rng = np.random.default_rng(5)
    n, cycles = 700, 9.37
    op = np.repeat(rng.normal(size=70), 10)
    load = 1.5 * sawtooth(2.0 * np.pi * (cycles * np.arange(n) / n + 0.4), rise)
    pole = np.exp(-1.0 / 6.0)
    pv = lfilter([0.0, 0.0, 0.0, 1.0 - pole], [1.0, -pole], op + load)
    window = case(op, pv + 0.02 * rng.normal(size=n), signed=False)
    wrong = window.fit(None, Poles(Shape.LAGS, 15.0), 0, (), np.zeros(0))
    found = fit_periodic_load(window, (wrong,))
    assert found is not None
    (wave,) = found.nuisances
    assert isinstance(wave, PeriodicLoad)
    assert wave.cycles == pytest.approx(cycles, abs=0.02)
    # of either sign: a wave that falls as long as the other rises
    assert min(abs(wave.rise - rise), abs(1.0 - wave.rise - rise)) < 0.03
    assert found.poles.slow == pytest.approx(6.0, rel=0.1)
    assert found.dead_time == 3


@pytest.mark.parametrize("seed", [2, 5, 9])
@pytest.mark.parametrize(
    ("period", "dead", "gain"), [(45, 8, 0.4), (90, 8, 0.4), (150, 2, 0.6), (150, 8, 0.4)]
)
def test_a_healthy_valve_under_it_is_not_accused(
    period: int, dead: int, gain: float, seed: int
) -> None:
    wave = sawtooth(2.0 * np.pi * (np.arange(900) / period + 0.17 * seed), 0.3)
    record = run(load=5.0 * wave, n=900, dead=dead, noise=0.03, seed=seed, gain=gain)
    result = identify(record.op, record.pv, sp=record.sp)
    assert result.verdict is Verdict.NO_STICTION
    assert not result.uncertain


@pytest.mark.parametrize("seed", [0, 2, 4, 5, 7])
def test_it_is_known_from_two_cycles_and_a_half(seed: int) -> None:
    wave = sawtooth(2.0 * np.pi * (np.arange(375) / 150 + 0.17 * seed), 0.3)
    record = run(load=5.0 * wave, n=375, dead=2, noise=0.03, seed=seed, gain=0.6)
    result = identify(record.op, record.pv, sp=record.sp)
    assert result.verdict is Verdict.NO_STICTION
    assert not result.uncertain


def test_the_interval_of_a_sticky_valve_under_it_holds_the_truth() -> None:
    wave = sawtooth(2.0 * np.pi * np.arange(900) / 150, 0.3)
    record = run(load=5.0 * wave, n=900, band=6.0, jump=4.0, noise=0.03, seed=2)
    result = identify(record.op, record.pv, sp=record.sp)
    assert result.verdict is Verdict.STICTION
    assert result.stick_band.low <= 6.0 <= result.stick_band.high


@pytest.mark.parametrize("seed", range(1, 11))
def test_a_sticky_valve_under_it_is_found(seed: int) -> None:
    wave = sawtooth(2.0 * np.pi * (np.arange(900) / 150 + 0.17 * seed), 0.3)
    record = run(load=5.0 * wave, n=900, band=6.0, jump=4.0, noise=0.03, seed=seed)
    result = identify(record.op, record.pv, sp=record.sp)
    assert result.verdict is Verdict.STICTION
    # the wave hides strokes: a third of the seeds misses the interval, none the size
    assert result.stick_band.value == pytest.approx(6.0, rel=0.3)
