"""The tuning family: reproducible loops, and valves that obey their own numbers."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.families.tuning import HEALTHY_KINDS, STICKY_KINDS, draw
from benchmarks.families.tuning.closed_loop import INNER_STEPS
from benchmarks.families.tuning.linear_process import Process, tune
from benchmarks.families.tuning.loads import find_strokes
from benchmarks.families.tuning.valves import LAWS, move_stem, valve_parameters, valve_state


def drive(law: str, stick_band: float, slip_jump: float, op: np.ndarray) -> np.ndarray:
    """Stem positions of a valve whose controller output follows `op`."""
    parameters = valve_parameters(stick_band, slip_jump, 0.5)
    state = valve_state(float(op[0]), parameters[1])
    stem = np.empty_like(op)
    for k, now in enumerate(op):
        for _ in range(INNER_STEPS):
            move_stem(LAWS.index(law), state, now, parameters, INNER_STEPS)
        stem[k] = state[0]
    return stem


@pytest.mark.parametrize("law", ["he", "kano", "sliding", "karnopp", "lugre"])
@pytest.mark.parametrize(("stick_band", "slip_jump"), [(8.0, 3.0), (12.0, 10.0)])
def test_a_slow_triangle_shows_stick_band_and_slip_jump(law, stick_band, slip_jump):
    up = np.arange(30.0, 70.0, 0.05)
    op = np.concatenate([up, up[::-1]])
    stem = drive(law, stick_band, slip_jump, op)
    moves = np.abs(np.diff(stem))
    # Bristles give way by less than half of OP's step; a stem that moves goes at least with OP.
    last_up = np.flatnonzero(moves[: len(up) - 1] > 0.025).max() + 1
    first_down = np.flatnonzero(moves[len(up) :] > 0.2 * slip_jump).min() + len(up) + 1
    assert op[last_up] - op[first_down] == pytest.approx(stick_band, rel=0.05)
    # Two scans later the slip is over, and a sliding stem has moved on with OP only.
    assert stem[last_up] - stem[first_down + 2] == pytest.approx(slip_jump, rel=0.08, abs=0.12)


def test_a_healthy_valve_follows_and_a_dead_band_lags_by_half_the_band():
    op = 50.0 + 10.0 * np.sin(np.arange(400) / 20.0)
    np.testing.assert_array_equal(drive("none", 0.0, 0.0, op), op)
    lag = op - drive("he", 6.0, 0.0, op)
    assert np.abs(lag[50:]).max() == pytest.approx(3.0)


@pytest.mark.parametrize(("kind", "sticky"), [("pi", True), ("lugre", True), ("held", False)])
def test_the_same_seed_gives_the_same_loop_and_another_seed_another(kind, sticky):
    first, again, other = draw(kind, sticky, 3), draw(kind, sticky, 3), draw(kind, sticky, 4)
    np.testing.assert_array_equal(first.op, again.op)
    np.testing.assert_array_equal(first.pv, again.pv)
    assert (first.name, first.stick_band, first.strokes, first.notes) == (
        again.name, again.stick_band, again.strokes, again.notes,
    )  # fmt: skip
    assert not np.array_equal(first.pv[:400], other.pv[:400])


@pytest.mark.parametrize(
    ("kinds", "sticky"), [(STICKY_KINDS, True), (HEALTHY_KINDS, False)], ids=["sticky", "healthy"]
)
def test_every_kind_stays_in_the_range_of_real_loops(kinds, sticky):
    for kind in kinds:
        loop = draw(kind, sticky, 0)
        assert len(loop.op) == len(loop.pv)
        assert 500 <= len(loop.op) <= 1500
        assert np.nanmin(loop.op) >= 0.0
        assert np.nanmax(loop.op) <= 100.0
        assert np.array_equal(np.isnan(loop.op), np.isnan(loop.pv))
        assert np.isnan(loop.pv).any() == (kind == "missing")
        assert (loop.law != "none") == sticky
        if sticky:
            assert 2.0 <= loop.stick_band <= 20.0
            assert 0.0 <= loop.slip_jump <= loop.stick_band
            assert loop.strokes >= 4
        else:
            assert loop.stick_band == loop.slip_jump == 0.0
    assert draw("few-strokes", sticky, 1).strokes <= 8


def test_kinds_have_the_mark_they_are_named_for():
    quantised = draw("quantised", False, 2)
    assert len(np.unique(quantised.pv)) < 0.2 * len(quantised.pv)
    assert not np.any(np.diff(draw("pi", True, 1).pv) == 0.0)
    assert all(np.any(np.diff(draw("held", True, seed).pv) == 0.0) for seed in range(4))
    bends = [np.abs(np.diff(draw("interpolated", True, k).pv, 2)) > 1e-9 for k in range(4)]
    assert all(bend.mean() < 0.9 for bend in bends)
    slip = draw("pure-slip", True, 1)
    assert slip.stick_band == slip.slip_jump
    assert draw("dead-band", True, 1).slip_jump == 0.0
    assert np.ptp(draw("setpoint-steps", False, 1).sp) > 0.0


def test_a_kind_that_makes_no_sense_is_refused():
    with pytest.raises(ValueError, match="no healthy loops of kind 'lugre'; choose one of pi"):
        draw("lugre", False, 0)
    with pytest.raises(ValueError, match="no sticky loops of kind 'tight-tuning'"):
        draw("tight-tuning", True, 0)


def test_strokes_are_counted_from_reversal_to_reversal():
    stem = np.array([0.0, 0.0, 5.0, 5.0, 9.0, 8.9, 4.0, 4.0, 4.1, 7.0])
    np.testing.assert_array_equal(find_strokes(stem, 1.0), [1, 4, 7])


def test_a_process_settles_at_its_gain_and_tuning_keeps_the_gain_margin():
    process = Process("lags", -2.0, 10.0, 3.0, 0.5, 2.0)
    transition, entry = process.discretise(8)
    settled = np.linalg.solve(np.eye(3) - transition, entry)
    np.testing.assert_allclose(settled, 1.0)
    gain, integral, rate = tune(process, 1.0, 0.0, 1.1, exact=True)
    assert gain < 0.0
    assert rate == 0.0
    # At the crossing of -180 degrees the loop's gain is 1 / 1.1.
    frequency = np.geomspace(0.01, 1.0, 20000)
    s = 1j * frequency
    loop = gain * process.gain * (1.0 + 1.0 / (integral * s)) * process.respond(frequency)
    crossing = np.flatnonzero(np.diff(np.sign(loop.imag)) > 0)[0]
    assert abs(loop[crossing]) == pytest.approx(1.0 / 1.1, rel=0.01)
