"""Random loops: drawn from the seed, physically sensible, and judged with honest arithmetic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.loops import KarnoppValve, Loop, draw_loop, record
from benchmarks.robustness import Judgement, group
from estimator.valves import HeValve


def _loop(**changes) -> Loop:
    base = Loop(
        seed=1,
        process="first order",
        controller="PI",
        physics="He",
        noise_kind="white",
        stick_band=4.0,
        slip_jump=1.0,
        noise=0.05,
        disturbance=0.0,
        sampling=0.2,
        dead_time=0,
        aggressive=1.0,
        trouble="none",
    )
    return replace(base, **changes)


def test_a_seed_gives_one_loop_and_one_window():
    assert draw_loop(5, healthy=False) == draw_loop(5, healthy=False)
    loop = draw_loop(6, healthy=False)
    np.testing.assert_array_equal(record(loop, samples=300).pv, record(loop, samples=300).pv)


def test_draws_cover_every_kind_and_stay_in_range():
    loops = [draw_loop(seed, healthy=False) for seed in range(200)]
    assert {loop.physics for loop in loops} == {"He", "Kano", "Choudhury", "Karnopp"}
    assert len({loop.process for loop in loops}) == 4
    assert all(0.5 <= loop.stick_band <= 10.0 for loop in loops)
    assert all(0.0 <= loop.slip_jump <= loop.stick_band for loop in loops)
    assert all(0.05 <= loop.sampling <= 1.0 for loop in loops)
    assert all(draw_loop(seed, healthy=True).is_healthy for seed in range(20))


@pytest.mark.parametrize("physics", ["He", "Kano", "Karnopp"])
@pytest.mark.parametrize("process", ["first order", "second order", "dead time", "integrating"])
def test_a_sticky_loop_cycles_and_its_stem_stays_within_the_friction(physics, process):
    loop = _loop(physics=physics, process=process, dead_time=3 * (process == "dead time"))
    window = record(loop, samples=600)
    assert window.turns >= 4
    assert np.abs(window.op - window.stem).max() <= 2.5 + 0.05  # fS = (S + J) / 2


def test_karnopps_valve_ends_every_slip_where_hes_does():
    """A stem with more than critical damping stops where spring and dynamic friction balance."""
    rng = np.random.default_rng(2)
    op = 50.0 + np.cumsum(rng.normal(0.0, 1.5, 300))
    karnopp = KarnoppValve(4.0, 1.0)
    moved = np.empty(op.size)
    stem = 50.0
    for k, value in enumerate(op):
        stem = karnopp(stem, float(value))
        moved[k] = stem
    he = HeValve(4.0, 1.0).simulate(op, 50.0)
    assert np.mean(np.abs(moved - he) < 0.1) > 0.9
    assert np.mean(np.diff(moved) == 0.0) > 0.3


def test_a_healthy_valve_follows_op():
    window = record(draw_loop(3, healthy=True), samples=300)
    np.testing.assert_array_equal(window.stem, window.op)


def test_group_counts_verdicts_and_covers():
    def judged(verdict, value, low, high):
        return Judgement(_loop(), verdict, (), 1.0, (value, low, high), (1.0, 0.5, 2.0), 9, 0.1)

    row = group(
        "made up",
        [
            judged("stiction", 4.4, 4.0, 5.0),
            judged("stiction", 3.8, 3.7, 3.9),
            judged("no_stiction", 0.1, 0.0, 0.2),
            judged("not_assessable", float("nan"), 0.0, 0.0),
        ],
    )
    name, count, found, missed, unknown, bias, _, error, jump, cover_s, cover_j = row
    assert (name, count, found, missed, unknown) == ("made up", 4, 0.5, 0.25, 0.25)
    assert bias == pytest.approx(0.025)
    assert error == pytest.approx(0.075)
    assert jump == 0.0
    assert (cover_s, cover_j) == (0.5, 1.0)
