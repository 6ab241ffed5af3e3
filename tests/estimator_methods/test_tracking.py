"""A valve over many windows: smoothing, changes, time left; against courses that were made up."""

from __future__ import annotations

import math

import numpy as np
import pytest

from estimator.monitoring.changes import ChangeKind, find_changes
from estimator.monitoring.tracking import track
from estimator.monitoring.trend import smooth_trend
from estimator.outcomes import EstimatorError
from estimator.result import Interval

DAY = 86400.0
QUANTILE = 1.6448536


def _windows(true, std, seed=0):
    rng = np.random.default_rng(seed)
    value = true + rng.normal(0.0, std, len(true))
    return [Interval(v, v - QUANTILE * std, v + QUANTILE * std) for v in value]


def test_a_straight_line_is_found_with_its_slope_and_the_days_left():
    days = np.arange(40.0)
    true = 2.0 + 0.05 * days
    course = track(days * DAY, _windows(true, 0.1), _windows(true, 0.1), stick_band_limit=5.0)
    band = course.stick_band
    assert 0.05 in band.trend_per_day
    assert band.value[-1] == pytest.approx(true[-1], abs=0.1)
    assert band.days_to_limit.low <= (5.0 - true[-1]) / 0.05 <= band.days_to_limit.high
    assert band.days_to_limit.value == pytest.approx(21.0, abs=5.0)


def test_intervals_cover_the_truth_as_often_as_they_say():
    days = np.sort(np.random.default_rng(5).uniform(0.0, 60.0, 30))
    true = 3.0 + 0.5 * np.sin(days / 15.0)
    inside = []
    for seed in range(30):
        band = track(days * DAY, _windows(true, 0.2, seed), _windows(true, 0.2, seed)).stick_band
        inside.append((band.low <= true) & (true <= band.high))
    assert 0.8 <= np.mean(inside) <= 0.97


def test_smoothing_beats_the_single_windows_and_bridges_gaps():
    days = np.arange(50.0)
    true = 4.0 + 0.02 * days
    windows = _windows(true, 0.3)
    windows[20:26] = [Interval.unknown()] * 6
    band = track(days * DAY, windows, windows).stick_band
    raw = np.array([one.value for one in windows])
    assert np.isfinite(band.value).all()
    assert np.nanstd(band.value - true) < 0.7 * np.nanstd(raw - true)
    assert band.high[22] - band.low[22] > band.high[10] - band.low[10]


def test_precise_windows_weigh_more():
    times = np.arange(10.0) * DAY
    windows = [Interval(2.0, 1.99, 2.01)] * 10
    windows[4] = Interval(6.0, 0.0, 12.0)
    band = track(times, windows, windows).stick_band
    assert band.value[4] == pytest.approx(2.0, abs=0.02)


def test_a_step_is_dated_and_a_repair_starts_again():
    true = np.concatenate([np.full(15, 2.0), np.full(15, 4.0), np.full(15, 1.0)])
    times = np.arange(45) * DAY
    band = track(times, _windows(true, 0.2), _windows(true, 0.2)).stick_band
    assert [change.kind for change in band.changes] == [ChangeKind.INCREASE, ChangeKind.DECREASE]
    assert [abs(c.onset - k) <= 2 for c, k in zip(band.changes, (15, 30), strict=True)] == [
        True
    ] * 2
    assert band.worse_since is None
    assert band.value[-1] == pytest.approx(1.0, abs=0.25)
    before = track(times[:30], _windows(true, 0.2)[:30], _windows(true, 0.2)[:30]).stick_band
    assert before.worse_since == pytest.approx(15 * DAY, abs=2 * DAY)


def test_a_slow_drift_gives_an_alarm_and_noise_rarely_does():
    steady = sum(
        bool(find_changes(np.random.default_rng(s).normal(3.0, 0.2, 40), np.full(40, 0.2)))
        for s in range(50)
    )
    assert steady <= 5
    for seed in range(5):
        drift = 3.0 + 0.03 * np.arange(60) + np.random.default_rng(seed).normal(0.0, 0.2, 60)
        kinds = {change.kind for change in find_changes(drift, np.full(60, 0.2))}
        assert kinds == {ChangeKind.INCREASE}


def _delays(before, reference, shift, runs=150, after=200):
    """Windows from a shift to its alarm, false alarms before it left out."""
    found = []
    for seed in range(runs):
        value = np.random.default_rng(seed).normal(size=before + after)
        value[before:] += shift
        changes = find_changes(value, np.ones(value.size), reference=reference)
        if changes and changes[0].alarm >= before:
            found.append(changes[0].alarm - before + 1)
    return np.array(found)


@pytest.mark.parametrize(("shift", "length"), [(1.0, 10.4), (1.5, 5.75), (2.0, 4.01)])
def test_delays_are_the_run_lengths_of_the_tables(shift, length):
    # Montgomery, Introduction to Statistical Quality Control, 6th ed., table 9.3: k = 0.5, h = 5
    assert np.mean(_delays(100, 100, shift)) == pytest.approx(length, rel=0.2)


def test_false_alarms_are_as_rare_as_the_table_says():
    # in control the average run length is 465
    alarms = [
        bool(find_changes(np.random.default_rng(seed).normal(size=100), np.ones(100)))
        for seed in range(150)
    ]
    assert np.mean(alarms) == pytest.approx(1.0 - math.exp(-95.0 / 465.0), abs=0.07)


def test_a_change_does_not_become_the_norm_it_is_measured_by():
    # with ten windows before it, a mean over all windows follows a shift by 1 before it adds up
    found = _delays(10, 5, 1.0, after=60)
    assert np.median(found) < 20
    assert found.size > 0.5 * 150
    wild = np.concatenate([np.zeros(12), [8.0], np.full(12, 2.0)])
    assert find_changes(wild, np.ones(wild.size))[0].onset in (12, 13)


def test_one_wild_window_gives_no_alarm():
    value = np.full(30, 2.0) + 0.05 * np.sin(np.arange(30.0))
    value[15] = 60.0
    assert find_changes(value, np.full(30, 0.1)) == ()


def test_more_scatter_than_the_intervals_allow_widens_them():
    rng = np.random.default_rng(1)
    value = 3.0 + rng.normal(0.0, 0.5, 40)
    trend = smooth_trend(np.arange(40.0), value, np.full(40, 0.05))
    assert trend.widening > 10.0
    assert abs(trend.level[20] - 3.0) < 3.0 * trend.level_std[20]


def test_no_trend_towards_the_limit_is_no_number_of_days():
    true = np.full(20, 2.0)
    windows = [Interval(v, v - 0.1, v + 0.1) for v in true - 0.01 * np.arange(20)]
    left = track(np.arange(20) * DAY, windows, windows, stick_band_limit=8.0).stick_band
    assert left.days_to_limit.value == math.inf
    over = track(np.arange(20) * DAY, windows, windows, stick_band_limit=1.0).stick_band
    assert over.days_to_limit.value == 0.0


def test_two_windows_have_no_trend():
    windows = [Interval(2.0, 1.8, 2.2)] * 2
    band = track([0.0, DAY], windows, windows, stick_band_limit=3.0).stick_band
    assert math.isnan(band.trend_per_day.value)
    assert math.isnan(band.days_to_limit.value)
    assert np.isfinite(band.value).all()


@pytest.mark.parametrize(
    ("times", "windows", "part"),
    [
        ([0.0, 0.0], [Interval(1, 0, 2)] * 2, "increasing"),
        ([0.0], [Interval(1, 0, 2)] * 2, "one length"),
        ([0.0, 1.0], [Interval.unknown()] * 2, "nothing to follow"),
        ([0.0, 1.0], [Interval(1, 2, 0)] * 2, "low end is above its high end"),
    ],
)
def test_bad_input_is_refused_with_its_name(times, windows, part):
    with pytest.raises(EstimatorError, match=part):
        track(times, windows, windows)


@pytest.mark.parametrize(("hours", "told"), [(0.1, False), (6.0, False), (25.0, True)])
def test_no_slope_per_day_is_told_of_less_than_a_day(hours: float, told: bool) -> None:
    times = np.linspace(0.0, 3600.0 * hours, 6)
    bands = [Interval(5.0 + 0.2 * k, 4.99 + 0.2 * k, 5.01 + 0.2 * k) for k in range(6)]
    found = track(times, bands, bands, stick_band_limit=20.0).stick_band
    assert np.isfinite(found.trend_per_day.value) == told
    assert np.isfinite(found.days_to_limit.value) == told
