"""What the watch makes of an error and of the stem's travel, scan by scan."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from compensator import HybridMpc, LoopFigures, SupervisorSettings
from compensator.supervising.figures import LoopRecord, Sample, oscillation_period
from compensator.supervising.harm import HarmWatch
from compensator.supervising.loop_judge import LoopJudge
from compensator.supervising.promise import PromiseSettings, PromiseWatch
from compensator.supervising.record_check import RecordCheckSettings
from compensator.supervising.watch import LoopWatch, Watched, WatchVerdict
from compensator.supervising.watch_settings import WatchSettings
from loop_model import LoopModel, ProcessModel, ValveModel

QUICK = WatchSettings(promise=PromiseSettings(shortest=10**6))
"""What the long run must reach is not asked."""


def test_a_growing_oscillation_is_noticed_within_five_periods() -> None:
    period, growth = 40, 1.3
    watch = LoopWatch(LoopFigures(0.04, 0.1, 100.0, 0.6))
    noise = np.random.default_rng(1).normal(0.0, 0.1, 20 * period)
    for k in range(20 * period):
        error = 0.5 * growth ** (k / period) * math.sin(2.0 * math.pi * k / period) + noise[k]
        if watch.push(Watched(error, 0.0, 0.01)) is not WatchVerdict.FINE:
            break
    # It begins at five deviations of the noise.
    assert k < 5 * period


def test_an_oscillation_worse_than_before_is_noticed_within_five_periods() -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2))
    for k in range(400):
        verdict = watch.push(Watched(1.05 * math.sin(2.0 * math.pi * k / 40.0), 0.8, 0.01))
        if verdict is not WatchVerdict.FINE:
            break
    assert verdict is WatchVerdict.WORSE
    assert k < 5 * 40


@pytest.mark.parametrize("amplitude", [0.9, 0.3])
def test_a_steady_oscillation_no_worse_than_before_is_let_be(amplitude: float) -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2), QUICK)
    noise = np.random.default_rng(2).normal(0.0, 0.1, 2000)
    for k in range(2000):
        error = amplitude * math.sin(2.0 * math.pi * k / 40.0) + noise[k]
        assert watch.push(Watched(error, 0.5, 0.01)) is WatchVerdict.FINE


def test_a_loop_that_rests_for_a_while_is_still_one_that_swung() -> None:
    # A cycle of 60 samples between two positions of the stem, then 300 samples at another
    # set-point at which the stem happens to stand right.
    record, valve = LoopRecord(1200), ValveModel(10.0, 5.0)
    noise = np.random.default_rng(5).normal(0.0, 0.05, 900)
    for k in range(600):
        angle = 2.0 * math.pi * k / 60.0
        record.push(Sample(math.sin(angle) + noise[k], 0.0, 50.0 + 9.0 * math.cos(angle), True))
    for k in range(600, 900):
        record.push(Sample(2.0 + noise[k], 2.0, 50.0, True))
    before = record.figures(80, 160, valve)
    assert before is not None
    # 600 of 860 settled samples swing: 40 of the new set-point are the way to it.
    assert before.mean_square == pytest.approx(600 / 860 * 0.5, rel=0.05)
    # One slip of J in each half of the ten cycles, and what OP's first position takes.
    assert before.travel * 860 == pytest.approx(10 * 2 * 5.0, rel=0.2)
    assert before.period == pytest.approx(60.0, rel=0.05)


def test_the_period_is_read_from_the_error() -> None:
    noise = np.random.default_rng(3).normal(0.0, 0.2, 600)
    errors = [math.sin(2.0 * math.pi * k / 60.0) + noise[k] for k in range(600)]
    assert oscillation_period(errors, 1.0) == pytest.approx(60.0, rel=0.05)
    assert oscillation_period([0.1, 0.2, 0.3], 77.0) == 77.0


def test_what_was_seen_before_a_set_point_change_still_counts() -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2))
    seen = 0
    for k in range(1000):
        if k % 70 == 0:
            watch.restart(20)
        seen += 1
        if (
            watch.push(Watched(1.1 * math.sin(2.0 * math.pi * k / 40.0), 0.8, 0.01))
            is WatchVerdict.WORSE
        ):
            break
    assert seen < 8 * 40


def test_an_overshoot_as_large_as_the_step_ends_it_at_once() -> None:
    watch = LoopWatch(LoopFigures(0.02, 1.0, 40.0, 2.0))
    watch.restart(60)
    for k in range(60):
        verdict = watch.push(Watched(-5.0 + 0.25 * k, 0.0, 0.0025))
        if verdict is not WatchVerdict.FINE:
            break
    assert verdict is WatchVerdict.GROWING
    assert k == 41


def test_an_error_far_beyond_all_that_was_known_ends_it_within_the_dead_time_and_eight() -> None:
    watch = LoopWatch(LoopFigures(0.02, 1.0, 40.0, 0.4), dead_time=5)
    for k in range(60):
        verdict = watch.push(Watched(0.1 * k, 0.0, 0.0025))
        if verdict is not WatchVerdict.FINE:
            break
    assert verdict is WatchVerdict.LEFT_RANGE
    assert k == 13 + 12  # beyond 1.2 from sample 13 on


def test_an_error_that_returns_is_none_that_ran_away() -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2), QUICK)
    for k in range(300):
        error = 5.0 * math.exp(-((k - 100.0) ** 2) / 18.0)
        assert watch.push(Watched(error, 0.0, 0.01)) is WatchVerdict.FINE


def test_op_at_its_limit_with_pv_leaving_ends_it() -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2), dead_time=1)
    for k in range(60):
        verdict = watch.push(Watched(1.0 + 0.05 * k, 0.0, 0.01, limited=True, at_limit=True))
        if verdict is not WatchVerdict.FINE:
            break
    assert verdict is WatchVerdict.LEFT_RANGE
    assert 1.0 + 0.05 * k < 3.0 * 1.2


def test_a_set_point_out_of_reach_is_not_worse() -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2))
    watch.restart(40)
    for _ in range(1000):
        assert (
            watch.push(Watched(-5.0, 0.0, 0.01, limited=True, at_limit=True)) is WatchVerdict.FINE
        )


def watch_of_a_slow_loop(horizon: int = 80) -> LoopWatch:
    return LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2), QUICK, horizon=horizon, dead_time=5)


def test_a_set_point_that_ramps_out_of_reach_and_back_is_no_runaway() -> None:
    watch = watch_of_a_slow_loop()
    sp, found = 0.0, set()
    for k in range(900):
        change = 0.1 if k < 300 else -0.1 if k >= 600 else 0.0
        sp += change
        pv = min(sp, 3.0)  # what OP's range allows
        found.add(watch.push(Watched(pv - sp, 0.0, 0.01, sp_change=change, limited=sp > 3.0)))
    assert found == {WatchVerdict.FINE}


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_pv_may_lag_behind_a_fast_set_point_but_not_leave_on_the_other_side(side: float) -> None:
    """A set-point that ramps by 0.4 a scan for 30 scans, inside the reach of OP."""
    watch = watch_of_a_slow_loop()
    found = set()
    for k in range(80):
        change = 0.4 if k < 30 else 0.0
        size = 0.4 * k if k < 30 else 12.0 * math.exp(-(k - 30) / 10.0)
        found.add(watch.push(Watched(side * size, 0.0, 0.01, sp_change=change)))
    assert (found == {WatchVerdict.FINE}) is (side < 0.0)
    assert (WatchVerdict.LEFT_RANGE in found) is (side > 0.0)


@pytest.mark.parametrize("lag", [12.0, 30.0])
def test_the_lag_of_pv_behind_a_long_ramp_is_not_worse_than_before(lag: float) -> None:
    """A set-point that ramps by 0.4 a scan: in the 40 scans that PV is given it goes 16."""
    watch = watch_of_a_slow_loop()
    errors = [-min(0.4 * k, lag) for k in range(300)]
    found = {watch.push(Watched(error, 0.0, 0.01, sp_change=0.4)) for error in errors}
    assert (found == {WatchVerdict.FINE}) is (lag < 16.0)


def test_an_error_at_the_take_over_may_take_long_to_return_but_has_to() -> None:
    """A level far off: it comes back by 0.2 a scan, for longer than a restart leaves out."""
    watch, stays = watch_of_a_slow_loop(), watch_of_a_slow_loop()
    for one in (watch, stays):
        one.restart(40)
    returned = {watch.push(Watched(max(40.0 - 0.2 * k, 0.0), 0.0, 0.01)) for k in range(260)}
    assert WatchVerdict.LEFT_RANGE not in returned
    found = {stays.push(Watched(max(40.0 - 0.2 * k, 20.0), 0.0, 0.01)) for k in range(260)}
    assert WatchVerdict.LEFT_RANGE in found


def test_travel_over_its_budget_is_noticed_however_good_pv_is() -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2), QUICK, stroke=10.0)
    found = [watch.push(Watched(0.05, 2.5, 1e-4)) for _ in range(300)]
    assert WatchVerdict.TRAVEL in found
    fair = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2), QUICK, stroke=10.0)
    assert all(fair.push(Watched(0.05, 1.9, 1e-4)) is WatchVerdict.FINE for _ in range(300))
    ramp = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2), QUICK, stroke=10.0)
    asked = [ramp.push(Watched(0.05, 2.5, 1e-4, sp_travel=1.0)) for _ in range(300)]
    assert set(asked) == {WatchVerdict.FINE}
    # A stem follows a ramp in steps: what each step does is what the scans before it asked for.
    steps = LoopWatch(LoopFigures(0.5, 0.02, 40.0, 1.2), QUICK, stroke=1.0)
    found = [
        steps.push(Watched(0.05, 5.0 * (k % 25 == 24), 1e-4, sp_travel=0.2)) for k in range(300)
    ]
    assert set(found) == {WatchVerdict.FINE}


def test_a_valve_at_rest_is_given_more_room() -> None:
    """What PV does then is noise: 1.5 times the mean square of before is no reason to give up."""
    watch = LoopWatch(LoopFigures(0.5, 1.0, 40.0, 1.2), QUICK)
    for k in range(2000):
        error = math.sqrt(1.5) * math.sin(2.0 * math.pi * k / 40.0)
        assert watch.push(Watched(error, 0.0, 0.2)) is WatchVerdict.FINE
    errors = [3.5 * math.sin(2.0 * math.pi * k / 40.0) for k in range(260)]
    assert any(watch.push(Watched(e, 0.0, 0.2)) is WatchVerdict.WORSE for e in errors)


@pytest.mark.parametrize(
    ("error", "way", "harmed"), [(1.2, 0.25, True), (0.9, 0.25, False), (1.2, 0.15, False)]
)
def test_only_more_deviation_and_more_travel_together_are_harm(
    error: float, way: float, harmed: bool
) -> None:
    watch = HarmWatch(mean_square=1.0, travel=0.1, stroke=5.0)
    verdicts = [watch.push(error, way, quiet=0.0) for _ in range(300)]
    assert any(verdicts) is harmed
    if harmed:
        assert verdicts.index(True) < 120


def test_a_loop_that_was_at_rest_may_make_a_correction() -> None:
    watch = HarmWatch(mean_square=0.01, travel=0.0, stroke=5.0)
    ways = [5.0 if k in (10, 14) else 0.0 for k in range(300)]
    assert not any(watch.push(1.0, way, quiet=0.0) for way in ways)


@pytest.mark.parametrize(
    ("share", "way", "noise", "broken"),
    [
        (0.4, 0.5, 0.0, ""),
        (0.7, 0.5, 0.0, "deviation"),
        (0.7, 0.5, 0.3, ""),  # noise makes most of it: no controller has anything to gain
        (0.4, 1.3, 0.0, "travel"),
    ],
)
def test_a_loop_is_given_back_that_gains_less_than_was_promised(
    share: float, way: float, noise: float, broken: str
) -> None:
    watch = PromiseWatch(mean_square=1.0, travel=1.0, stroke=5.0, window=200)
    found = [watch.push(share, way, noise) for _ in range(400)]
    assert found[-1] == broken
    assert not any(found[: PromiseSettings().shortest - 1])


@pytest.mark.parametrize(("way", "broken"), [(0.0, False), (0.3, True)])
def test_slow_noise_is_taken_off_where_the_stem_rests(way: float, broken: bool) -> None:
    # Noise of the variance 0.25 that repeats itself over thirty scans, once believed far smaller.
    steps = np.random.default_rng(5).normal(0.0, 0.5 * math.sqrt(1.0 - 0.93**2), 4000)
    errors = np.asarray(lfilter([1.0], [1.0, -0.93], steps))
    watch = PromiseWatch(mean_square=0.64, travel=1.0, stroke=5.0, window=240)
    assert watch.push(0.0, way, 0.01) == ""
    found = {watch.push(float(error), way, 0.25) for error in errors}
    assert ("deviation" in found) is broken


def test_a_slow_loop_that_travels_far_too_much_is_given_back_before_its_window_is_full() -> None:
    watch = PromiseWatch(mean_square=1.0, travel=0.05, stroke=6.0, window=1000)
    found = [watch.push(0.3, 0.2, 0.0) for _ in range(300)]
    assert found[-1] == "travel"
    assert not any(found[: int(4 * 6.0 / (0.2 - 0.05))])  # not before it has used up the strokes
    # The strokes that it is allowed are not refused to it in so short a time.
    watch = PromiseWatch(mean_square=1.0, travel=0.05, stroke=6.0, window=1000)
    assert not any(watch.push(0.3, 0.1, 0.0) for _ in range(300))


def first_verdict(
    watch: LoopWatch, amplitude: float, travel: float, noise: float, period: float
) -> tuple[int, WatchVerdict]:
    for k in range(1000):
        error = amplitude * math.sin(2.0 * math.pi * k / period)
        verdict = watch.push(Watched(error, travel, noise))
        if verdict is not WatchVerdict.FINE:
            return k, verdict
    return 1000, WatchVerdict.FINE


def test_the_strokes_that_no_loop_is_refused_are_not_granted_anew_in_each_window() -> None:
    # 2.5 times as far as before, for good: 24 OP a window, and not four stick bands more than 10.6.
    watch = PromiseWatch(mean_square=1.0, travel=0.04, stroke=6.0, window=240)
    found = [watch.push(0.3, 0.1, 0.0) for _ in range(1500)]
    first = next(k for k, broken in enumerate(found) if broken)
    assert found[first] == "travel"
    assert 600 < first < 750  # five stick bands at 0.044 OP a scan, and 30 scans
    # What a stem saves is not kept: before, it rested for as long as it likes.
    watch = PromiseWatch(mean_square=1.0, travel=0.04, stroke=6.0, window=240)
    found = [watch.push(0.3, way, 0.0) for way in [0.0] * 3000 + [0.1] * 1500]
    assert 3600 < next(k for k, broken in enumerate(found) if broken) < 3750


def test_the_strokes_that_no_loop_is_refused_come_back_within_their_renewal() -> None:
    watch = PromiseWatch(mean_square=1.0, travel=0.001, stroke=6.0, window=240)
    renewal = PromiseSettings().renewal
    burst = [6.0, 5.0, 6.0, 6.0, *[0.0] * (renewal - 4)]  # nearly all four, once in a renewal
    assert not any(watch.push(0.3, way, 0.0) for _ in range(5) for way in burst)
    # What learning takes is granted once: of two such bursts in a renewal, the second one is over.
    twice = [6.0, 5.0, 6.0, 6.0, *[0.0] * (renewal // 2 - 4)]
    assert any(watch.push(0.3, way, 0.0) for _ in range(5) for way in twice)


def test_the_way_that_a_load_takes_the_stem_along_is_not_counted() -> None:
    # A load that goes by 0.1 OP a scan for 600 scans, and back.
    watch = PromiseWatch(mean_square=1.0, travel=0.04, stroke=6.0, window=240)
    stems = [0.1 * min(k, 1200 - k) for k in range(1200)]
    assert not any(watch.push(0.3, 0.1, 0.0, stem) for stem in stems)
    # A stem that goes as far to and fro.
    watch = PromiseWatch(mean_square=1.0, travel=0.04, stroke=6.0, window=240)
    assert any(watch.push(0.3, 0.1, 0.0, float(k // 10 % 2)) for k in range(1200))


def test_travel_that_gains_nothing_is_given_half_as_much() -> None:
    def scans(error: float) -> int:
        watch = PromiseWatch(mean_square=1.0, travel=0.04, stroke=6.0, window=240)
        found = (watch.push(error, 0.12, 0.0) for _ in range(1000))
        return next(k for k, broken in enumerate(found) if broken == "travel")

    # 0.064 OP a scan beyond what is granted: five stick bands of 6 OP, or three of them.
    assert 450 < scans(0.5) < 520
    assert 270 < scans(0.6) < 330


def test_a_stem_that_travels_far_in_any_case_may_do_so_unevenly() -> None:
    # 40 scans at twice the travel of before, 40 at rest: eight times four stick bands at a time.
    watch = PromiseWatch(mean_square=1.0, travel=5.0, stroke=6.0, window=240)
    ways = ([10.0] * 40 + [0.0] * 40) * 12
    assert not any(watch.push(0.3, way, 0.0) for way in ways)


def test_a_loop_without_gain_is_given_back_within_three_and_a_half_periods() -> None:
    watch = LoopWatch(LoopFigures(0.5, 1.0, 120.0, 1.2))
    scans, verdict = first_verdict(watch, 0.8, 0.8, 0.01, 120.0)
    assert verdict is WatchVerdict.NO_GAIN
    assert scans < 3.5 * 120


def test_what_a_wrong_model_takes_for_noise_excuses_no_travelling_stem() -> None:
    # The noise believed is a third of the mean square known: its three deviations are more than it.
    known, noise = 0.5, 0.17
    worse = LoopWatch(LoopFigures(known, 1.0, 60.0, 1.2), QUICK)
    assert first_verdict(worse, 1.2, 0.8, noise, 60.0)[1] is WatchVerdict.WORSE
    resting = LoopWatch(LoopFigures(known, 1.0, 60.0, 1.2), QUICK)
    assert first_verdict(resting, 1.2, 0.0, noise, 60.0)[1] is WatchVerdict.FINE


@pytest.mark.parametrize("pole", [0.9, 0.998])
def test_a_level_taken_for_a_slow_lag_is_not_excused_by_the_gain_that_it_never_reaches(
    pole: float,
) -> None:
    """Both models make the same of a slip at first; the loop swung with a period of 12."""
    slow = LoopModel(ValveModel(6.0, 2.0), ProcessModel((-pole,), (0.02,), 2, 0.0, 1.0))
    settings = SupervisorSettings(check=RecordCheckSettings(shortest=10**6))
    judge = LoopJudge(settings, LoopRecord(1200))
    compensator = HybridMpc(slow)
    errors = np.random.default_rng(4).normal(0.0, 0.02, 900)
    for k in range(100):
        compensator.observe(float(errors[k]), 50.0)
    judge.begin(LoopFigures(0.03, 2.5, 12.0, 0.5), compensator)
    verdict = WatchVerdict.FINE
    for k in range(900):
        error = 0.36 * math.sin(0.07 * k) + float(errors[k])
        verdict = judge.push(compensator, error, 0.0, 50.0, 1.0)
        if verdict is not WatchVerdict.FINE:
            break
    assert verdict in (WatchVerdict.WORSE, WatchVerdict.NO_GAIN)


def verdict_on(errors: list[float], travel: float) -> tuple[int, WatchVerdict]:
    watch = LoopWatch(LoopFigures(1.0, 0.2, 100.0, 3.0), QUICK)
    for k, error in enumerate(errors):
        verdict = watch.push(Watched(error, travel, 0.01))
        if verdict is not WatchVerdict.FINE:
            return k, verdict
    return len(errors), WatchVerdict.FINE


def test_what_a_window_will_hold_at_least_is_not_waited_for() -> None:
    # PV at twice its deviation before: a window of 2.5 periods of 100 samples is over 1.8 times the
    # mean square of before once 0.45 of it are seen, whatever comes then.
    scans, verdict = verdict_on([2.0] * 400, travel=0.2)
    assert verdict is WatchVerdict.WORSE
    assert scans < 2.0 * 100


def test_what_will_have_left_the_window_by_then_makes_no_verdict() -> None:
    # The window is over its limit when it is full, but no longer an eighth of it later.
    assert verdict_on([5.0] * 30 + [0.1] * 1000, travel=0.15)[1] is WatchVerdict.FINE
