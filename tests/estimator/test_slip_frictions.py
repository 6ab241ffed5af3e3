"""A sticky valve whose friction is another one at every slip."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import multivariate_normal, norm

from benchmarks import uneven_friction
from estimator import Identification, Verdict, identify
from estimator.diagnosis import CauseName, diagnose
from estimator.evidence.slip_frictions import find_varying_friction, lead_of_slips
from estimator.evidence.verdict import count_strokes
from estimator.hypotheses.friction_paths import Frictions, follow_paths
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.hypotheses.noise import WHITE
from estimator.processes.poles import Poles, Shape
from tests.estimator.slipping import slip_by_chance
from tests.seeds import in_suite

Array = NDArray[np.float64]

PROCESS = Poles(Shape.LAGS, 3.0, 1.0, 0.5)
GAINS, LATE, TAPS, VARIANCE = (0.7, 0.4), 2, np.array([0.5, -0.2]), 0.02


def shown(stem: Array) -> Array:
    """What PV shows of a stem: process, gains and dead time, whitened by the noise model."""
    response = PROCESS.response(stem)
    late = np.concatenate([np.zeros(LATE + 1), response])
    pv = GAINS[0] * late[1:][: stem.size] + GAINS[1] * late[: stem.size]
    return np.asarray(lfilter([1.0, *-TAPS], [1.0], pv))


def followed(
    op: Array, target: Array, frictions: Frictions, weight: Array | None = None, *, slides: bool
) -> tuple[float, Array]:
    """The kernel on all but the first rows, with the constants of a density that it leaves out."""
    weight = np.ones(op.size) if weight is None else weight.copy()
    weight[:LATE] = 0.0
    process = PROCESS.coefficients, GAINS, LATE, VARIANCE
    worth, stem = follow_paths(
        op, target, weight, TAPS, float(op[0]), frictions, process, 1e-9, slides
    )
    return worth - 0.5 * float(weight.sum()) * np.log(2.0 * np.pi), stem


def path_of(
    op: Array, slips: tuple[int, ...], frictions: Frictions, *, slides: bool
) -> tuple[float, Array]:
    """Chance and stem of a path: ``slips`` is a way, up, down or none, a row after the first.

    Each stretch of rest has a static friction of its own, one for each way.
    """
    static, dynamic, spread = frictions[:3]
    stem, chance, way = np.full(op.size, op[0]), 1.0, 0
    high = low = op[0]
    for k in range(1, op.size):
        x = stem[k - 1]
        if way * (op[k] - op[k - 1]) > 0.0:
            if slips[k - 1] != 0:
                return 0.0, stem
            stem[k] = x + op[k] - op[k - 1]
            continue
        if way != 0:
            high = low = op[k - 1]
            way = 0
        free = norm(static, spread)
        up = free.cdf(max(high, op[k]) - x) - free.cdf(high - x)
        down = free.cdf(x - min(low, op[k])) - free.cdf(x - low)
        up, down = up / free.sf(high - x), down / free.sf(x - low)
        chance *= {0: (1.0 - up) * (1.0 - down), 1: up, -1: down}[slips[k - 1]]
        stem[k] = x if slips[k - 1] == 0 else op[k] - slips[k - 1] * dynamic
        high, low = max(high, op[k]), min(low, op[k])
        if slips[k - 1] != 0:
            high = low = op[k]
            way = slips[k - 1] if slides else 0
    return chance, stem


@pytest.mark.parametrize("slides", [False, True])
def test_it_is_the_sum_over_all_paths(slides: bool) -> None:
    """Each path's chance times the density of PV under its stem, summed one by one."""
    op = np.array([0.0, 0.5, 1.1, 1.5, 1.2, 0.4, -0.3, -0.9, -0.7])
    frictions = 0.9, 0.3, 0.25, 0.0, 0.0
    truth = path_of(op, (0, 1, 0, 0, 0, -1, 0, 0), frictions, slides=False)[1]
    target = shown(truth) + np.sqrt(VARIANCE) * np.random.default_rng(4).normal(size=op.size)
    total, best = 0.0, (0.0, truth)
    for slips in product((0, 1, -1), repeat=op.size - 1):
        chance, stem = path_of(op, slips, frictions, slides=slides)
        if chance <= 0.0:
            continue
        density = norm(shown(stem)[LATE:], np.sqrt(VARIANCE)).pdf(target[LATE:]).prod()
        total += chance * density
        best = max(best, (chance * density, stem), key=lambda one: one[0])
    worth, stem = followed(op, target, frictions, slides=slides)
    assert worth == pytest.approx(np.log(total), abs=0.02)
    # what PV does not show yet is not known
    assert stem[:-LATE] == pytest.approx(best[1][:-LATE])


def test_dynamic_friction_and_lateness_of_chance_are_integrated_over() -> None:
    """One path, and the density of PV whose covariance both deviations tell."""
    op = np.concatenate([np.zeros(4), np.full(6, 3.0), np.full(7, -2.0)])
    static, dynamic, deviation, late = 1.0, 0.4, 0.3, 0.5
    slips = (4, 1.0), (10, -1.0)
    stem = np.zeros(op.size)
    ends, parts = np.zeros((2, op.size)), np.zeros((2, op.size))
    for i, (row, way) in enumerate(slips):
        before = stem[row - 1]
        stem[row:] = op[row] - way * dynamic
        ends[:, row:] = 0.0
        ends[i, row:] = 1.0
        parts[i, row] = late * (stem[row] - before)
    # a place that is not known moves all of the later PV until the next slip
    columns = np.array([shown(one) for one in [*(deviation * ends), *parts]])
    covariance = VARIANCE * np.eye(op.size) + columns.T @ columns
    rng = np.random.default_rng(8)
    target = shown(stem) + rng.multivariate_normal(np.zeros(op.size), covariance)
    weight = np.ones(op.size)
    weight[[0, 1, 2, 12]] = 0.0
    seen = weight > 0.0
    expected = multivariate_normal(shown(stem)[seen], covariance[np.ix_(seen, seen)])
    frictions = static, dynamic, 0.02, deviation, late
    worth, _ = followed(op, target, frictions, weight, slides=False)
    # the last part's size hangs on where the stem stood, which is known after the first slip only
    assert worth == pytest.approx(expected.logpdf(target[seen]), abs=0.2)


def _uneven(seed: int, spread: float) -> tuple[Array, Array, Array]:
    """OP, stem and PV of a valve of S 5, J 3 whose friction varies by a share of S."""
    rng = np.random.default_rng(seed)
    n = 700
    op = 50.0 + 4.6 * np.sin(np.arange(n) / 14.0 + 0.6 * np.sin(np.arange(n) / 50.0))
    stem = slip_by_chance(op, spread, rng)
    pv = np.asarray(lfilter([0.0, 0.12], [1.0, -0.88], stem - 50.0))
    return op, stem, pv + 0.02 * rng.normal(size=n)


def _by_law(window: Case, op: Array) -> tuple[Hypothesis, float, Poles]:
    """The law of the means, scaled OP over OP, and the process."""
    scale = float(window.rows.u.std() / op.std())
    poles = Poles(Shape.LAGS, 7.8)
    valve = Valve(5.0 * scale, 3.0 * scale, float(window.rows.u[0]))
    return window.fit(valve, poles, 0, (), WHITE), scale, poles


@pytest.mark.parametrize("seed", in_suite(2, range(10)))
def test_slips_of_uneven_friction_are_found_where_no_law_does(
    case: Callable[..., Case], seed: int
) -> None:
    op, stem, pv = _uneven(seed, 0.06)
    window = case(op, pv, signed=False)
    sticky, scale, poles = _by_law(window, op)
    valve = sticky.valve
    # in place of a load: PV behind the very stem
    known = window.fit(valve, poles, 0, (), WHITE, stem=(stem - op[0]) * scale + window.rows.u[0])
    slips = np.count_nonzero(np.diff(stem))
    lead = lead_of_slips(window, sticky, known)
    # a slip costs what is not known of it beforehand: when, and how far
    assert -12.0 * slips < lead < 0.0
    assert lead + known.likelihood - sticky.likelihood > 50.0


def _judged(seed: int) -> Identification:
    """What is found of an uneven valve; its slips must be those of its stem."""
    op, stem, pv = _uneven(seed, 0.06)
    found = identify(op, pv, period=1.0)
    if found.verdict is Verdict.STICTION:
        assert found.stick_band.low < 5.0 < found.stick_band.high
        assert found.slip_jump.low < 3.0 < found.slip_jump.high
        assert found.evidence.strokes == pytest.approx(count_strokes(stem), abs=2)
        assert found.evidence.steady > 50.0
        # nearly everywhere where the stem stood
        off = np.abs(found.stem - found.stem.mean() - (stem - stem.mean()))
        assert np.median(off) < 0.1 * 5.0
        assert any("friction changes from slip to slip" in one for one in found.identifiability)
    return found


@pytest.mark.parametrize("seed", [4, 10])
def test_an_uneven_valve_is_told_by_the_means_of_its_friction(seed: int) -> None:
    """The law's stem misses slips: their number, S and J are those of a stem that may slip."""
    found = _judged(seed)
    assert found.verdict is Verdict.STICTION
    assert found.stick_band.value == pytest.approx(5.0, rel=0.1)
    assert found.slip_jump.value == pytest.approx(3.0, rel=0.2)


@pytest.mark.thorough
def test_means_of_friction_are_near_for_many_uneven_valves() -> None:
    """A law alone tells S by a fifth and more too small for half of them."""
    found = [one for one in map(_judged, range(20)) if one.verdict is Verdict.STICTION]
    assert len(found) >= 18
    band = np.array([one.stick_band.value for one in found])
    jump = np.array([one.slip_jump.value for one in found])
    assert np.median(np.abs(band / 5.0 - 1.0)) < 0.05
    assert np.abs(band / 5.0 - 1.0).max() < 0.15
    assert np.median(np.abs(jump / 3.0 - 1.0)) < 0.12


@pytest.mark.parametrize("seed", in_suite(2, range(20)))
def test_a_valve_of_one_friction_stays_that_of_its_law(
    case: Callable[..., Case], seed: int
) -> None:
    op, _, pv = _uneven(seed, 0.0)
    window = case(op, pv, signed=False)
    assert find_varying_friction(window, _by_law(window, op)[0]) is None
    found = identify(op, pv, period=1.0)
    assert found.stick_band.value == pytest.approx(5.0, rel=0.02)
    assert found.stick_band.high - found.stick_band.low < 0.1 * 5.0


def test_a_law_that_lost_the_valve_does_not_count_its_strokes() -> None:
    """The likeliest law makes two strokes of ten: verdict and diagnosis go by the slips."""
    loop = uneven_friction.draw(54)
    assert loop is not None
    found = identify(loop.op, loop.pv, period=1.0)
    assert found.verdict is Verdict.STICTION
    assert found.evidence.strokes == pytest.approx(count_strokes(loop.stem), abs=2)
    first = diagnose(loop.op, loop.pv, period=1.0, advice=False, figures=False).causes[0]
    assert first.name is CauseName.STICKY_VALVE
