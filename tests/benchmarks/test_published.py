"""Published methods say of a drawn signal what their papers say of it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.published import count_shapes, find_stuck_intervals, fit_curve, judge_bicoherence

TIME = np.arange(1200)
TRIANGLE = 2.0 * np.abs((TIME / 60.0) % 1.0 - 0.5) - 0.5
SINE = np.sin(2.0 * np.pi * TIME / 60.0)
# What the stem of a sticky valve does under a triangular OP: it rests until OP has gone far enough.
SQUARE = np.where((TIME / 60.0) % 1.0 < 0.5, 1.0, -1.0)


def _noise(seed, size=0.02):
    return size * np.random.default_rng(seed).standard_normal(TIME.size)


def test_a_triangle_is_the_valve_and_a_sine_is_not():
    assert fit_curve(TRIANGLE + _noise(1), SQUARE).call == "stiction"
    assert fit_curve(SINE + _noise(1), SINE).call == "no_stiction"


def test_of_an_integrating_process_the_curve_is_pv():
    assert fit_curve(SINE, TRIANGLE + _noise(2), integrating=True).call == "stiction"


def test_a_pv_that_rests_while_op_moves_has_the_shapes_of_sticking():
    resting = count_shapes(TRIANGLE, SQUARE)
    following = count_shapes(SINE, np.roll(SINE, 3))
    assert resting.call == "stiction"
    assert following.call == "no_stiction"
    assert resting.score > 2.0 * following.score


def test_the_stuck_intervals_span_what_op_travels_in_them():
    finding = find_stuck_intervals(TRIANGLE, SQUARE)
    assert finding.call == "stiction"
    assert finding.stick_band == pytest.approx(np.ptp(TRIANGLE), rel=0.1)


def test_bicoherence_tells_coupled_phases_from_gaussian_noise():
    # Quadratic phase coupling: a wave and its square, the example of the method's theory.
    rng = np.random.default_rng(5)
    phases = np.repeat(rng.uniform(0.0, 2.0 * np.pi, 1200 // 32 + 1), 32)[: TIME.size]
    wave = np.cos(2.0 * np.pi * TIME * 6 / 64 + phases)
    coupled = wave + wave**2 + _noise(6, 0.1)
    assert judge_bicoherence(TRIANGLE, coupled).score > 0.0
    assert judge_bicoherence(TRIANGLE, _noise(7, 1.0)).call == "no_stiction"


@pytest.mark.parametrize("method", [fit_curve, count_shapes, find_stuck_intervals])
def test_a_still_loop_is_undecided(method):
    still = np.ones(300)
    assert method(still, still).call == "undecided"
