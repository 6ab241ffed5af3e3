"""What a historian leaves of a window: drawn lines, held values, missing samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator import ReasonCode, Verdict, identify
from estimator.cleaning import find_held, find_slow_transmitter
from estimator.evidence.records import informed_share
from loop_model import ValveModel
from tests.seeds import cases_in_suite, few_and_all

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def window(loop) -> tuple[Array, Array]:
    op, pv, _ = loop(ValveModel(5.0, 2.0), samples=600, noise=0.05, seed=1)
    return op, pv


def _interpolated(signal: Array, every: int) -> Array:
    """Straight lines between every so many samples."""
    k = np.arange(signal.size)
    return np.interp(k, k[::every], signal[::every])


def _held(signal: Array, dead_band: float) -> Array:
    """Stored by exception: the last value until the signal has left it by the dead band."""
    held, last = [], signal[0]
    for value in signal:
        if abs(value - last) > dead_band:
            last = value
        held.append(last)
    return np.array(held)


@pytest.mark.parametrize("every", [2, 3, 6, 10])
def test_the_informed_share_of_straight_lines_is_that_of_their_knots(every: int) -> None:
    signal = np.random.default_rng(0).normal(size=1201)
    assert informed_share(_interpolated(signal, every)) == pytest.approx(1.0 / every, abs=0.01)
    assert informed_share(signal) == 1.0


@pytest.mark.parametrize("which", ["pv", "both"])
def test_an_interpolated_record_is_not_judged_but_polled(window, which: str) -> None:
    op, pv = window
    if which != "pv":
        op = _interpolated(op, 8)
    pv = _interpolated(pv, 8)
    result = identify(op, pv)
    assert result.verdict is Verdict.NOT_ASSESSABLE
    (reason,) = result.reasons
    assert reason.code is ReasonCode.RECORD_INTERPOLATED
    assert reason.advice.startswith("Poll the loop")


def test_a_record_with_one_measured_sample_of_three_is_judged_with_wider_intervals(window) -> None:
    op, pv = window
    drawn = identify(op, _interpolated(pv, 3))
    assert drawn.verdict is Verdict.STICTION
    assert drawn.stick_band.low <= 5.0 <= drawn.stick_band.high
    whole = identify(op, pv).stick_band
    assert drawn.stick_band.high - drawn.stick_band.low > whole.high - whole.low


def test_a_record_stored_by_exception_is_not_called_frozen(window) -> None:
    op, pv = window
    held = _held(pv, 0.2 * float(np.std(pv)))
    longest = max(len(run) for run in np.split(held, np.flatnonzero(np.diff(held)) + 1))
    assert (np.diff(held) == 0.0).mean() > 0.5  # most samples repeat, none stands still for long
    assert longest < 0.1 * held.size
    result = identify(op, held)
    assert ReasonCode.PV_FROZEN not in {reason.code for reason in result.reasons}
    assert result.verdict is Verdict.STICTION


def test_missing_samples_up_to_the_limit_are_judged_without_them(window) -> None:
    op, pv = window
    rng = np.random.default_rng(2)
    for share, judged in ((0.1, True), (0.4, False)):
        worse = pv.copy()
        worse[rng.permutation(pv.size)[: int(share * pv.size)]] = np.nan
        result = identify(op, worse)
        assert (result.verdict is Verdict.STICTION) is judged
        codes = {reason.code for reason in result.reasons}
        assert (ReasonCode.TOO_MANY_BAD_SAMPLES in codes) is not judged


def test_the_value_of_a_bad_sample_changes_nothing(window) -> None:
    # a sentinel that a driver writes into OP where PV is bad is the only thing that differs
    op, pv = window
    pv = pv.copy()
    pv[100:104] = np.nan
    masked = op.copy()
    masked[101:103] = np.nan
    plain, other = identify(op, pv), identify(masked, pv)
    assert other.verdict is plain.verdict
    assert other.stick_band.value == pytest.approx(plain.stick_band.value, rel=0.02)


def _polled(signal: Array, every: int, first: int) -> Array:
    """Polled every so many samples, from one on, and stored at each."""
    place = np.arange(signal.size) - first
    return signal[np.maximum(place // every * every + first, 0)]


@pytest.mark.parametrize(("every", "first"), cases_in_suite(1, [(3, 2), (2, 0), (5, 1)]))
def test_a_record_that_keeps_each_value_is_judged_on_each_value_once(
    loop, every: int, first: int
) -> None:
    op, pv, _ = loop(ValveModel(5.0, 2.0), samples=400, noise=0.1, seed=2)
    held = tuple(np.concatenate([one[:1].repeat(first), one.repeat(every)]) for one in (op, pv))
    found, once = identify(*held, period=1.0), identify(op, pv, period=every)
    assert found.score == once.score
    assert found.stick_band == once.stick_band
    assert (found.period_s, found.samples) == (every, 400)
    assert found.stem.size == found.pv_model.size == held[0].size
    assert np.array_equal(found.stem[first::every], once.stem)
    assert f"keeps each value for {every} samples" in found.identifiability[-1]


@pytest.mark.parametrize("seeds", few_and_all(5, range(10)))
def test_healthy_valves_of_records_that_keep_each_value_are_not_accused(
    loop, seeds: Sequence[int]
) -> None:
    # without this 5 of 36 healthy loops of the tuning family are, stored so
    for seed in seeds:
        op, pv, _ = loop(None, samples=1500, noise=0.3, drift=0.05, seed=seed, time_constant=20.0)
        record = _polled(op, 5, seed % 5), _polled(pv, 5, seed % 5)
        assert identify(*record).verdict is not Verdict.STICTION


def test_records_that_change_at_any_sample_keep_no_value() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        op = np.cumsum(rng.normal(size=500))
        assert find_held(op, rng.normal(size=500)).every == 1
        assert find_held(_polled(op, 3, 1), rng.normal(size=500)).every == 1
        assert find_held(_held(op, 2.0), _held(op, 3.0)).every == 1
        assert find_held(np.repeat(op[:8], 50), np.repeat(op[:8], 50)).every == 1
        lost = np.where(np.arange(500) % 7 == 3, np.nan, _polled(op, 5, 0))
        assert find_held(lost, lost).every == 1


def _measured_slowly(
    seed: int, every: int, band: float, *, jitter: int = 0, samples: int = 1500
) -> tuple[Array, Array]:
    """OP of every scan, and PV as an analyser with a new value every so many scans gives it.

    A lag of 15 and a dead time of 4 scans, a load that wanders, a PI controller that answers what
    it sees; He's valve with a slip jump of half its band (band 0: healthy).
    """
    rng = np.random.default_rng([seed, every])
    load = 0.15 * np.cumsum(rng.normal(size=samples))
    load -= np.linspace(load[0], load[-1], samples)
    op, pv = np.zeros(samples), np.zeros(samples)
    stem, lag, seen, integral, due = 0.0, 0.0, 0.0, 0.0, 0
    past = np.zeros(5)
    for k in range(samples):
        lag += (past[k % 5] + load[k] - lag) / 15.0
        if k >= due:
            seen = lag + 0.05 * rng.normal()
            due = k + every + int(rng.integers(-jitter, jitter + 1))
        integral -= 0.9 / 15.0 * seen
        op[k], pv[k] = integral - 0.9 * seen, seen
        if abs(op[k] - stem) > 0.75 * band:
            stem = op[k] - np.sign(op[k] - stem) * 0.25 * band
        past[k % 5] = stem
    return op, pv


@pytest.mark.parametrize(
    ("every", "jitter"), cases_in_suite(3, [(2, 0), (6, 1), (12, 0), (3, 0), (6, 0)])
)
def test_a_healthy_valve_is_not_accused_by_a_transmitter_slower_than_the_scan(
    every: int, jitter: int
) -> None:
    # the controller moves OP while PV stands: without this half of them are
    for seed in range(4):
        found = identify(*_measured_slowly(seed, every, 0.0, jitter=jitter))
        assert found.verdict is not Verdict.STICTION
        assert found.period_s == pytest.approx(every, rel=0.03)
        assert f"PV has a new value every {found.period_s:.3g} samples" in found.identifiability[-1]
        assert found.stem.size == found.pv_model.size == 1500


@pytest.mark.parametrize("seeds", few_and_all(5, range(10)))
def test_a_sticky_valve_is_found_behind_a_slow_transmitter(seeds: Sequence[int]) -> None:
    found = [identify(*_measured_slowly(seed, 2, 6.0)) for seed in seeds]
    assert sum(one.verdict is Verdict.STICTION for one in found) >= 0.9 * len(seeds)
    assert sum(6.0 in one.stick_band for one in found) >= 0.8 * len(seeds)


def test_only_values_that_come_by_a_clock_are_those_of_a_slow_transmitter() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        walk = np.cumsum(rng.normal(size=900))
        assert find_slow_transmitter(_polled(walk, 4, 1)).every == 4.0
        assert find_slow_transmitter(rng.normal(size=900)).every == 1
        assert find_slow_transmitter(_held(walk, 2.0)).every == 1
        assert find_slow_transmitter(np.round(walk / 5.0)).every == 1
        # a level in coarse steps that rises and falls steadily, as in a limit cycle
        ramp = np.abs(np.arange(900) % 200 - 100) / 4.0
        assert find_slow_transmitter(np.floor(ramp + 1e-9)).every == 1
        # a clock of its own: 5 or 6 samples between values
        ticks = (np.arange(900) / 5.4).astype(int)
        assert find_slow_transmitter(walk[ticks]).every == pytest.approx(5.4, rel=0.01)
