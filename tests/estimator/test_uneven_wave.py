"""A load that swings to and fro, no two swings alike, is not taken for a sticky valve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from estimator import Identification, Verdict, identify
from estimator.evidence import rival_waves, weighing
from estimator.evidence.cycle_turns import cycles_of
from estimator.evidence.outlined_turns import turns_of
from estimator.evidence.turns_by_chance import precision_of, price_of_turns, spread_of
from estimator.evidence.uneven_waves import find_uneven_wave
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.hypotheses.uneven_wave import UnevenWave, course_of, slopes_of
from estimator.processes.poles import Poles, Shape
from tests.closed_loop import run
from tests.seeds import cases_in_suite, few_and_all, in_suite

Array = NDArray[np.float64]

STRAIGHT = np.zeros((2, 0))
TIMES = np.array([-7.5, 20.2, 51.1, 88.8, 120.3])
HEIGHTS = np.array([1.0, -2.0, 1.5, -1.0, 2.0])


def uneven_wave(n: int, period: float, rise: float, seed: int) -> Array:
    """A wave of straight lines whose lengths and heights differ by about a tenth."""
    rng = np.random.default_rng(seed)
    count = 2 * int(n / period) + 8
    shares = np.where(np.arange(count) % 2 == 0, rise, 1.0 - rise)
    turns = np.cumsum(period * shares * (1.0 + 0.1 * rng.standard_normal(count))) - period
    heights = np.where(np.arange(count) % 2 == 0, -1.0, 1.0) * (
        1.0 + 0.08 * rng.standard_normal(count)
    )
    return np.interp(np.arange(n), turns, heights)


def wandering_triangle(n: int, period: float, spread: float, seed: int) -> Array:
    """A triangle between -1 and 1; the lengths of its cycles differ by ``spread``."""
    rng = np.random.default_rng(seed)
    lengths = period * (1.0 + spread * rng.standard_normal(int(n / period) + 6))
    bottoms = np.cumsum(lengths) - 2.0 * period * rng.uniform(0.5, 1.0)
    turns = np.sort(np.concatenate([bottoms, bottoms[:-1] + 0.5 * np.diff(bottoms)]))
    heights = np.where(np.arange(turns.size) % 2 == 0, -1.0, 1.0)
    return np.interp(np.arange(n), turns, heights)


def test_without_bends_it_is_drawn_in_straight_lines_from_turn_to_turn() -> None:
    times, heights = TIMES, HEIGHTS
    drawn = np.interp(np.arange(100.0), times, heights)
    np.testing.assert_allclose(course_of(100, times, heights, STRAIGHT), drawn, atol=1e-12)
    wave = UnevenWave(tuple(times), tuple(heights), ((), ()), None, 3.0)
    column = wave.columns(np.zeros(100), Poles(Shape.LAGS, 6.0), 0)
    np.testing.assert_allclose(column[0], drawn / np.abs(drawn).max(), atol=1e-12)


def test_its_slopes_are_the_differences_of_its_course() -> None:
    times, heights = TIMES, HEIGHTS
    bends = np.array([[0.1, -0.1], [-0.05, 0.2]])

    def course(numbers: Array) -> Array:
        return course_of(100, numbers[:5], numbers[5:10], numbers[10:].reshape(-1, 2).T)

    at = np.concatenate([times, heights, bends.T.ravel()])
    slopes = slopes_of(times, heights, bends, 100)
    for i, step in enumerate(1e-6 * np.eye(at.size)):
        differences = (course(at + step) - course(at - step)) / 2e-6
        np.testing.assert_allclose(slopes[i], differences, atol=1e-6)


def test_what_turns_cost_is_what_the_likelihood_loses_when_it_is_integrated_over_them() -> None:
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.normal(30.0, 2.0, 8))
    heights = np.where(np.arange(8) % 2 == 0, 1.0, -1.0) + 0.1 * rng.standard_normal(8)
    spread = spread_of(times, heights, np.zeros((16, 16)))
    precision, mean = precision_of(spread, times[0], 8, 0)
    # a linear window of unit noise, in which Laplace's approximation is exact
    slopes, middle = rng.normal(size=(16, 40)), np.linalg.solve(precision, mean)
    seen = slopes.T @ np.concatenate([times, heights]) + rng.standard_normal(40)
    told = slopes @ slopes.T
    at = np.linalg.solve(told + precision, slopes @ seen + mean)
    most = multivariate_normal(slopes.T @ at, np.eye(40)).logpdf(seen)
    spread_seen = np.eye(40) + slopes.T @ np.linalg.inv(precision) @ slopes
    integrated = multivariate_normal(slopes.T @ middle, spread_seen).logpdf(seen)
    # seven numbers of the distributions at half a log of the rows
    cost = price_of_turns(at, told, precision, mean, 40.0) - 3.5 * np.log(40.0)
    assert cost == pytest.approx(most - integrated, abs=1e-6)


def test_its_turns_are_those_of_the_outline_and_cover_the_window() -> None:
    load = uneven_wave(900, 60.0, 0.4, 1)
    (times, heights), *_ = turns_of(load)
    inside = (times > 0.0) & (times < 899.0)
    turning = 1 + np.flatnonzero(np.diff(np.sign(np.diff(load))))
    away = np.abs(times[inside][:, None] - turning)
    assert away.min(axis=1).max() <= 1.0
    # all but those next to the ends
    assert away.min(axis=0)[1:-1].max() <= 1.0
    np.testing.assert_allclose(heights[inside], load[times[inside].astype(int)])
    assert times[0] <= 0.0
    assert times[-1] >= 899.0
    assert (np.diff(times) > 0.0).all()


def test_an_outline_that_does_not_repeat_itself_or_would_have_too_many_turns_has_none() -> None:
    rng = np.random.default_rng(2)
    anywhere = np.sort(rng.choice(900, 24, replace=False))
    heights = np.tile([-1.0, 1.0], 12)
    assert not list(turns_of(np.interp(np.arange(900), anywhere, heights)))
    assert not list(turns_of(np.zeros(900)))
    # a dozen turns, eight samples apart: as many through the whole window are too fast
    quick = np.interp(np.arange(900), 400 + 8 * np.arange(12), np.tile([-1.0, 1.0], 6))
    assert not list(turns_of(quick))
    assert list(turns_of(quick[380:520]))


@pytest.fixture(scope="module")
def saw_tooth_window(case) -> Case:
    """A healthy valve under an uneven saw-tooth, accused without it."""
    load = 4.0 * uneven_wave(900, 80.0, 0.05, 3)
    record = run(load=load, n=900, noise=0.05, gain=0.5, seed=3)
    window: Case = case(record.op, record.pv)
    return window


def _accuses(result: Identification) -> bool:
    """Whether a valve is called sticky without doubt."""
    return result.verdict is Verdict.STICTION and not result.uncertain


def _has_wave(one: Hypothesis) -> bool:
    return any(isinstance(nuisance, UnevenWave) for nuisance in one.nuisances)


@pytest.mark.parametrize(("beyond", "rivals"), [(-0.01, False), (0.01, True)])
def test_it_is_a_rival_where_it_is_likelier_than_the_valve(
    saw_tooth_window: Case, monkeypatch: pytest.MonkeyPatch, beyond: float, rivals: bool
) -> None:
    find, asked = rival_waves.find_uneven_wave, []

    def found(case: Case, sticky: Hypothesis, least: float) -> Hypothesis | None:
        one = find(case, sticky, least)
        assert one is not None
        asked.append(least - sticky.likelihood)
        return replace(one, likelihood=sticky.likelihood + beyond)

    monkeypatch.setattr(weighing, "lead_of_slips", lambda *_: np.inf)
    monkeypatch.setattr(rival_waves, "find_wave_in_cycles", lambda *_: None)
    monkeypatch.setattr(rival_waves, "find_uneven_wave", found)
    weighed = weighing.weigh(saw_tooth_window)
    assert not _has_wave(weighed.healthy)
    assert np.isfinite(weighed.over_waves) == rivals
    assert asked == [pytest.approx(10.0)]


@pytest.mark.parametrize(
    ("behind", "counts", "doubts"), [(20.1, True, None), (19.9, False, True), (-10.1, False, False)]
)
def test_it_counts_where_a_valve_whose_slips_vary_is_twice_as_far_behind(
    saw_tooth_window: Case,
    monkeypatch: pytest.MonkeyPatch,
    behind: float,
    counts: bool,
    doubts: bool | None,
) -> None:
    leads = []

    def find(case: Case, sticky: Hypothesis, least: float) -> Hypothesis | None:
        one = find_uneven_wave(case, sticky, least)
        assert one is not None
        leads.append(one.likelihood)
        return one

    monkeypatch.setattr(rival_waves, "find_wave_in_cycles", lambda *_: None)
    monkeypatch.setattr(rival_waves, "find_uneven_wave", find)
    monkeypatch.setattr(rival_waves, "likelihood_of_varying_slips", lambda *_: leads[-1] - behind)
    monkeypatch.setattr(rival_waves, "lead_of_slips", lambda *_: -np.inf)
    weighed = weighing.weigh(saw_tooth_window)
    assert _has_wave(weighed.healthy) is counts
    if doubts is None:
        assert weighed.over_waves == np.inf
    else:
        assert weighed.over_waves == pytest.approx(-behind)
        assert (weighed.over_waves < saw_tooth_window.settings.judging.threshold) is doubts


@pytest.mark.parametrize(("deviations", "counts"), [(4.4, False), (4.5, True)])
def test_it_counts_where_pv_follows_op_beside_it_by_ten_nats(
    saw_tooth_window: Case, monkeypatch: pytest.MonkeyPatch, deviations: float, counts: bool
) -> None:
    """A gain of 4.47 deviations is likelier than none by 10 nats."""
    told = rival_waves.gain_deviations

    def gain_deviations(case: Case, of: Hypothesis) -> float:
        return deviations if _has_wave(of) else told(case, of)

    monkeypatch.setattr(rival_waves, "gain_deviations", gain_deviations)
    assert _has_wave(weighing.weigh(saw_tooth_window).healthy) is counts


def test_both_valves_beside_it_are_judged_on_the_same_rows_and_pay_for_it(
    saw_tooth_window: Case,
) -> None:
    window = saw_tooth_window
    found = weighing.weigh(window)
    assert found.sticky is not None
    assert found.evidence < 0.0
    for one in (found.healthy, found.sticky):
        assert _has_wave(one)
        left = lfilter([1.0, *-one.taps], [1.0], one.residual)[window.rows.weight > 0.0]
        assert left.size == window.rows.count
        assert float(left @ left) == pytest.approx(one.squares, rel=1e-9)
        others = tuple(
            nuisance for nuisance in one.nuisances if not isinstance(nuisance, UnevenWave)
        )
        (wave,) = (nuisance for nuisance in one.nuisances if isinstance(nuisance, UnevenWave))
        price = window.price(one.poles, others, one.taps, one.valve is not None)
        paid = window.log_likelihood(one.squares) - one.likelihood - price
        assert paid == pytest.approx(wave.nats, abs=1e-6)
        # more than the four means and three deviations alone
        assert wave.nats > 3.5 * np.log(window.rows.count)


@pytest.mark.parametrize(
    ("at_valve", "rise", "seed"),
    [(True, 0.1, 3), (True, 0.3, 2), (True, 0.5, 1), (False, 0.1, 3), (False, 0.3, 3)],
)
def test_a_triangle_that_wanders_is_found_with_the_process_behind_a_healthy_valve(
    case, at_valve: bool, rise: float, seed: int
) -> None:
    """Where the outline tells its turns; of other seeds it does not tell them all."""
    rng = np.random.default_rng(5)
    n = 900
    op = np.repeat(rng.normal(size=90), 10)
    load = 2.0 * uneven_wave(n, 70.0, rise, seed)
    pole = np.exp(-1.0 / 6.0)
    pv = lfilter([0.0, 0.0, 0.0, 1.0 - pole], [1.0, -pole], op)
    pv += lfilter([1.0 - pole], [1.0, -pole], load) if at_valve else load
    window: Case = case(op, pv + 0.02 * rng.normal(size=n), signed=False)
    sticky = window.fit(Valve(1.0, 0.5, 0.0), Poles(Shape.LAGS, 15.0), 0, (), np.zeros(0))
    found = find_uneven_wave(window, sticky, -np.inf)
    assert found is not None
    assert found.valve is None
    (wave,) = found.nuisances
    assert isinstance(wave, UnevenWave)
    assert (wave.through is not None) == at_valve
    assert found.poles.slow == pytest.approx(6.0, rel=0.1)
    turning = 1 + np.flatnonzero(np.diff(np.sign(np.diff(load))))
    judged = turning[(turning > 60) & (turning < n - 10)]
    away = np.abs(np.array(wave.times)[:, None] - judged).min(axis=0)
    assert away.max() < 2.0


@pytest.mark.parametrize("seeds", few_and_all(1, (1, 3, 4, 7)))
def test_healthy_valves_under_an_uneven_saw_tooth_are_not_accused(seeds: Sequence[int]) -> None:
    """Three of these four were, when a load of steps and lines was the only rival."""
    accused = 0
    for seed in seeds:
        load = 4.0 * uneven_wave(900, 80.0, 0.05, seed)
        record = run(load=load, n=900, noise=0.05, gain=0.5, seed=seed)
        accused += _accuses(identify(record.op, record.pv, sp=record.sp))
    assert accused <= len(seeds) // 4


@pytest.mark.parametrize("seeds", few_and_all(1, range(1, 5)))
def test_healthy_valves_under_an_uneven_triangle_are_mostly_cleared(seeds: Sequence[int]) -> None:
    """Seven of these eight were accused when the wave was looked for beside a drift alone."""
    accused = 0
    for period, rise in ((90.0, 0.5), (70.0, 0.3)):
        for seed in seeds:
            load = 6.0 * uneven_wave(900, period, rise, seed)
            record = run(load=load, n=900, noise=0.05, gain=0.5, seed=seed)
            accused += _accuses(identify(record.op, record.pv, sp=record.sp))
    assert accused <= len(seeds)


@pytest.mark.parametrize("rise", [0.1, 0.3, 0.5])
def test_a_wave_of_four_cycles_is_outlined(rise: float) -> None:
    """Its distributions have seven numbers, and it has eight turns."""
    load = uneven_wave(240, 60.0, rise, 1)
    found = list(turns_of(load))
    assert found
    assert not list(turns_of(load[:150]))
    for times, _ in found:
        assert ((times > 0.0) & (times < 239.0)).sum() >= 7


@pytest.mark.parametrize("seeds", few_and_all(2, range(1, 5)))
def test_sticky_valves_under_an_uneven_saw_tooth_are_found(seeds: Sequence[int]) -> None:
    found = 0
    for seed in seeds:
        load = 2.0 * uneven_wave(900, 80.0, 0.05, seed)
        record = run(load=load, n=900, band=6.0, jump=3.0, noise=0.05, gain=0.8, seed=seed)
        found += identify(record.op, record.pv, sp=record.sp).verdict is Verdict.STICTION
    assert found >= 0.75 * len(seeds)


def test_cycles_are_as_long_as_those_of_the_load(case) -> None:
    """OP goes up and down once for each cycle of a load that a controller answers."""
    load = wandering_triangle(900, 40.0, 0.05, 2)
    record = run(load=4.0 * load, n=900, noise=0.05, gain=0.5, seed=2)
    cycles = cycles_of(case(record.op, record.pv))
    assert cycles is not None
    bottoms = 1 + np.flatnonzero(np.diff(np.sign(np.diff(load))) > 0)
    inside = cycles[(cycles > bottoms[0]) & (cycles < bottoms[-1])]
    assert abs(inside.size - bottoms.size) <= 1
    # each begins as long after a turn of the load as the others, within a tenth of a cycle
    since = np.array([(at - bottoms[bottoms <= at][-1]) / 40.0 for at in inside])
    apart = np.angle(np.exp(2j * np.pi * (since - np.median(since)))) / (2.0 * np.pi)
    assert np.std(apart) < 0.1
    assert cycles[0] < 0.0
    assert cycles[-1] > 899.0


def test_op_that_does_not_go_up_and_down_has_no_cycles(case) -> None:
    rng = np.random.default_rng(4)
    op = np.cumsum(rng.normal(size=600))
    assert cycles_of(case(op, lfilter([0.2], [1.0, -0.8], op), signed=False)) is None


@pytest.mark.parametrize("seed", in_suite(1, [7, 1, 9, 0, 2, 3, 4, 5, 6, 8]))
@pytest.mark.parametrize(("period", "size"), cases_in_suite(1, [(40.0, 4.0), (30.0, 6.0)]))
def test_healthy_valves_under_a_fast_triangle_that_wanders_are_not_accused(
    period: float, size: float, seed: int
) -> None:
    """Of these twenty three were, and two more left uncertain: no corner of it pays alone."""
    load = size * wandering_triangle(900, period, 0.03 if period == 40.0 else 0.02, seed)
    record = run(load=load, n=900, noise=0.05, gain=0.5, seed=seed)
    assert not _accuses(identify(record.op, record.pv, sp=record.sp))
