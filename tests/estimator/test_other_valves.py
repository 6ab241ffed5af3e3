"""Intervals where no law is quite the valve's: slow records, slips that vary between strokes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator import identify
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.intervals.posterior import EXACT, sample_posterior
from estimator.processes.poles import Poles, Shape
from loop_model import ValveModel
from tests.seeds import few_and_all

Array = NDArray[np.float64]
CaseOf = Callable[..., Case]

VALVE = ValveModel(6.0, 2.0)
EVERY = 5


def _slow_record(seed: int, scans: int = 2700) -> tuple[Array, Array]:
    """Every fifth scan of a PI loop with a lag of 25 scans: some five samples a stroke."""
    rng = np.random.default_rng(seed)
    op, pv, flow = np.zeros(scans), np.zeros(scans), np.zeros(scans)
    stem, level, total, load = 0.0, 0.0, 0.0, 0.0
    for k in range(scans):
        pv[k] = level + 0.05 * rng.normal()
        total -= 0.6 * pv[k]
        op[k] = total - 6.0 * pv[k]
        stem = VALVE.step(stem, op[k])
        load = 0.98 * load + 0.1 * rng.normal()
        flow[k] = stem + load
        level += (1.0 - np.exp(-1.0 / 25.0)) * (flow[max(0, k - 2)] - level)
    return op[200::EVERY], pv[200::EVERY]


@pytest.mark.parametrize("seeds", few_and_all(5, range(20)))
def test_a_record_slower_than_the_scan_shows_the_stick_band(seeds: Sequence[int]) -> None:
    found = [identify(*_slow_record(seed), period=float(EVERY)) for seed in seeds]
    errors = [abs(one.stick_band.value / VALVE.stick_band - 1.0) for one in found]
    # turns that no sample shows cost a seventh of S where they are not thought of
    assert np.median(errors) < 0.09
    assert sum(VALVE.stick_band in one.stick_band for one in found) >= 0.8 * len(seeds)
    assert sum(VALVE.slip_jump in one.slip_jump for one in found) >= 0.8 * len(seeds)


BAND = 0.8
LAG = Poles(Shape.LAGS, 6.0)


def _peaks(seed: int, samples: int = 500) -> Array:
    """OP that rises and falls by turns, 20 samples each, with peaks that vary a little."""
    rng = np.random.default_rng(seed)
    count = samples // 20 + 2
    knots = (0.5 + 0.02 * rng.normal(size=count)) * np.where(np.arange(count) % 2, 1.0, -1.0)
    op = np.interp(np.arange(samples), 20.0 * np.arange(count), knots)
    found: Array = (op - 0.5 * (op.max() + op.min())) / np.ptp(op)
    return found


def _fitted(
    case: CaseOf, seed: int, valve: Valve, noise: float, after_turns: float = 0.0
) -> tuple[Case, Hypothesis]:
    """The window of a valve behind a lag, and the valve's own fit to it.

    ``noise`` is a share of PV's deviation. ``after_turns`` is how much more, in units of it, there
    is for three samples after each turn of the stem, as if every slip were another one.
    """
    op, rng = _peaks(seed), np.random.default_rng(seed)
    stem = valve.stem(op)
    pv = LAG.response(stem)
    size = noise * pv.std()
    pv = pv + size * rng.normal(size=pv.size)
    for turn in np.flatnonzero(np.diff(stem)) + 1:
        pv[turn : turn + 3] += after_turns * size * rng.normal()
    window = case(op, pv, signed=False)
    return window, window.fit(valve, LAG, 0, (), np.zeros(0), refit_noise=False)


def test_all_slip_jumps_that_explain_pv_alike_are_in_the_interval(case: CaseOf) -> None:
    # one slip a stroke: with another J and another gain the stem moves at the same samples
    held = 0
    for seed in range(20):
        valve = Valve(BAND, 0.9 * BAND, -0.46)
        window, best = _fitted(case, seed, valve, noise=0.15)
        moves = np.diff(best.stem)
        side = float(np.sign(moves[moves != 0.0][0]))
        alike = []
        for share in np.linspace(0.05, 1.0, 20):
            start = valve.start - side * 0.5 * (share - 0.9) * BAND
            other = replace(valve, jump=share * BAND, start=start)
            fit = window.fit(other, LAG, 0, (), best.taps, refit_noise=False)
            if fit.likelihood > best.likelihood - 0.5:
                alike.append(share)
        posterior = replace(sample_posterior(window, (best,)), gaps=(EXACT,))
        found = posterior.interval(0.0, 1.0 / BAND, 0.9)
        held += found.low <= min(alike) + 0.05 and found.high >= max(alike) - 0.05
    assert held >= 16


def test_a_lead_is_believed_as_far_as_pv_fits_after_the_stem_s_turns(case: CaseOf) -> None:
    def doubt(seed: int, after_turns: float) -> float:
        valve = Valve(0.5, 0.35, -0.4)
        window, best = _fitted(case, seed, valve, 0.05, after_turns)
        # another law, that moves the stem otherwise and is 60 nats behind
        sliding = replace(valve, law="sliding")
        behind = replace(
            best, valve=sliding, stem=best.stem + 0.5, likelihood=best.likelihood - 60.0
        )
        sure, doubtful = sample_posterior(window, (best, behind)).gaps
        assert sure.share + doubtful.share == 1.0
        assert doubtful.above > 5.0 * sure.above
        return doubtful.share

    exact, uneven = (np.array([doubt(seed, more) for seed in range(10)]) for more in (0.0, 3.0))
    assert np.all(uneven > 2.0 * exact)
