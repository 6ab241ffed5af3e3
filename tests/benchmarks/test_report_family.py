"""The report family: its valves, its historians and its loops are what they claim to be."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.families.report import KINDS, draw
from benchmarks.families.report.closed_loop import Wiring, simulate
from benchmarks.families.report.plants import NO_LOOP, tune
from benchmarks.families.report.records import (
    hold_by_exception,
    store_box_car,
    store_swinging_door,
)
from benchmarks.families.report.valves import (
    HEALTHY,
    LAWS,
    STATES,
    Valve,
    measure_by_ramp,
    move_stem,
    start_stem,
)
from tests.seeds import in_suite

BOTH = [
    (kind.name, sticky)
    for kind in KINDS.values()
    for sticky in (False, True)
    if (kind.sticky if sticky else kind.healthy)
]


@pytest.mark.parametrize("law", ["he", "kano", "sliding"])
@pytest.mark.parametrize(("band", "jump"), [(5.0, 2.0), (5.0, 5.0), (8.0, 1.0)])
def test_a_slow_ramp_finds_the_band_and_the_jump_of_a_law(law, band, jump):
    valve = Valve(LAWS[law], (band + jump) / 2, (band - jump) / 2)
    assert measure_by_ramp(valve, 0.005) == pytest.approx((band, jump), abs=0.03 * band)


@pytest.mark.parametrize("law", ["karnopp", "lugre"])
def test_a_valve_with_forces_leaves_rest_at_its_static_friction(law):
    valve = Valve(LAWS[law], 4.0, 2.0, viscous=0.05, inertia=1e-4, stribeck=5.0, stiffness=100.0)
    state = np.zeros(STATES)
    start_stem(state, 0.0)
    ramp = np.arange(0.0, 6.0, 0.002)
    stem = np.array([move_stem(valve, state, u, 0.02) for u in ramp])
    slip = ramp[np.argmax(stem > 0.25)]
    # Bristles give way over a few of their own bends, a fiftieth of the friction each.
    assert slip == pytest.approx(4.0, rel=0.08)


@pytest.mark.parametrize("store", in_suite(1, [store_swinging_door, store_box_car]))
def test_what_compression_returns_passes_through_the_stored_samples(store):
    signal = np.cumsum(np.random.default_rng(3).standard_normal(500))
    read, kept = store(signal, 2.0, 100)
    assert 0.02 < kept.mean() < 0.8
    np.testing.assert_allclose(read[kept], signal[kept])


def test_swinging_door_stays_within_its_band():
    signal = np.cumsum(np.random.default_rng(4).standard_normal(500))
    read, _ = store_swinging_door(signal, 2.0, 100)
    assert np.abs(read - signal).max() <= 2.0 + 1e-9


def test_holding_by_exception_stays_within_its_band():
    signal = np.cumsum(np.random.default_rng(5).standard_normal(500))
    read, _ = hold_by_exception(signal, 1.5, 100)
    assert np.abs(read - signal).max() <= 1.5


@pytest.mark.parametrize(("more", "dies_out"), [(0.8, True), (1.3, False)])
def test_the_gain_margin_is_where_the_loop_becomes_unstable(more, dies_out):
    plant = NO_LOOP[0]._replace(gain=-2.0, lag=10.0, dead_time=4.0)
    margin = 2.0
    controller = tune(plant, NO_LOOP[1]._replace(integral=12.0), margin, 20.0)
    controller = controller._replace(gain=more * margin * controller.gain)
    quiet = np.zeros((2, 1200))
    kick = quiet.copy()
    kick[0, 10:20] = 1.0
    wiring = Wiring(0, 0.0, 0.0, 0.0, 4, 1.0)
    _, pv, _, _ = simulate(
        (plant, NO_LOOP[0]), (HEALTHY, HEALTHY), (controller, NO_LOOP[1]), wiring,
        quiet, kick, quiet, quiet,
    )  # fmt: skip
    assert (np.ptp(pv[-300:]) < 0.2 * np.ptp(pv[:300])) == dies_out


@pytest.mark.parametrize(("kind", "sticky"), BOTH)
def test_a_loop_is_what_its_kind_asks_for(kind, sticky):
    loop = draw(kind, sticky, 7)
    assert loop.op.shape == loop.pv.shape
    assert loop.sp is None or loop.sp.shape == loop.pv.shape
    assert np.isfinite(loop.op).mean() > 0.6
    assert np.isfinite(loop.pv).mean() > 0.6
    assert (loop.law != "none") == sticky
    assert 0.0 <= loop.slip_jump <= loop.stick_band * 1.001
    assert (loop.stick_band > 0.0) == sticky
    if sticky and loop.assessable:
        assert loop.stick_band >= 0.02 * (np.nanmax(loop.op) - np.nanmin(loop.op))
        assert loop.strokes >= 4


def test_most_loops_can_be_told_by_one_who_sees_the_stem():
    loops = [draw(kind, True, seed) for kind in ("pi", "he", "setpoint-steps") for seed in range(8)]
    assert np.mean([loop.assessable for loop in loops]) > 0.7


def test_the_same_seed_gives_the_same_loop_and_another_seed_another():
    first, again, other = (
        draw("karnopp", True, 3),
        draw("karnopp", True, 3),
        draw("karnopp", True, 4),
    )
    np.testing.assert_array_equal(first.pv, again.pv)
    assert first.stick_band != other.stick_band


@pytest.mark.parametrize(("kind", "sticky"), [("wobble", True), ("tight-tuning", True)])
def test_a_loop_that_does_not_exist_is_refused_in_a_sentence(kind, sticky):
    with pytest.raises(ValueError, match=kind):
        draw(kind, sticky, 1)
