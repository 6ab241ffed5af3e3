"""The published valve models: facts they share, facts that tell them apart."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from estimator.valves import (
    ChoudhuryValve,
    HeValve,
    KanoValve,
    SemiPhysicalValve,
    SlipStickValve,
    SmoothedValve,
)
from loop_model import ValveModel

MODELS = [HeValve, SmoothedValve, SemiPhysicalValve, KanoValve, ChoudhuryValve]

signals = arrays(np.float64, st.integers(2, 80), elements=st.floats(-50.0, 50.0, width=32))
pairs = st.tuples(st.floats(0.0, 20.0), st.floats(0.0, 1.0)).map(lambda p: (p[0], p[0] * p[1]))


@pytest.mark.parametrize("model", MODELS)
@given(op=signals, pair=pairs, stem0=st.floats(-10.0, 10.0))
@settings(max_examples=40, deadline=None)
def test_simulate_does_what_repeated_steps_do(model, op, pair, stem0):
    valve: SlipStickValve = model(*pair)
    state = valve.start(float(op[0]), stem0)
    expected = []
    for value in op:
        state = valve.step(state, float(value))
        expected.append(state.stem)
    np.testing.assert_array_equal(valve.simulate(op, stem0), expected)


@given(op=signals, pair=pairs, stem0=st.floats(-10.0, 10.0))
@settings(max_examples=100, deadline=None)
def test_he_is_the_shared_reference_model(op, pair, stem0):
    reference = ValveModel(*pair)
    expected = reference.simulate(op, stem0)
    # where OP stands just at the edge of the band, rounding decides whether the stem slips
    ahead = np.abs(op - np.concatenate([[stem0], expected[:-1]]))
    assume(np.abs(ahead - reference.static_friction).min() > 1e-9)
    np.testing.assert_allclose(HeValve(*pair).simulate(op, stem0), expected, atol=1e-12)


@given(op=signals, pair=pairs, tau=st.sampled_from([1e4, 1e5, 1e6]))
@settings(max_examples=150, deadline=None)
def test_smoothed_is_he_from_tau_1e4_away_from_the_switching_tie(op, pair, tau):
    stem0 = float(op[0])
    exact = HeValve(*pair).simulate(op, stem0)
    before = np.concatenate([[stem0], exact[:-1]])
    to_the_tie = np.abs(np.abs(op - before) - HeValve(*pair).static_friction)
    if to_the_tie.min() < 20.0 / tau:
        return
    smooth = SmoothedValve(*pair, tau=tau).simulate(op, stem0)
    np.testing.assert_allclose(smooth, exact, atol=1e-8)


@pytest.mark.parametrize("model", [HeValve, KanoValve])
@given(op=signals, pair=pairs)
@settings(max_examples=80, deadline=None)
def test_the_stem_is_never_further_from_op_than_the_static_friction(model, op, pair):
    valve = model(*pair)
    gap = np.abs(op - valve.simulate(op, float(op[0])))
    assert gap.max() <= valve.static_friction + 1e-9


@pytest.mark.parametrize("model", MODELS)
@given(op=signals, pair=pairs, stem0=st.floats(-10.0, 10.0))
@settings(max_examples=40, deadline=None)
def test_mirrored_op_gives_the_mirrored_stem(model, op, pair, stem0):
    valve = model(*pair)
    up = valve.simulate(op, stem0)
    down = valve.simulate(-op, -stem0)
    np.testing.assert_allclose(down, -up, atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
@given(wiggle=arrays(np.float64, 60, elements=st.floats(-0.49, 0.49)), pair=pairs)
@settings(max_examples=40, deadline=None)
def test_no_move_inside_the_band(model, wiggle, pair):
    stick_band, slip_jump = pair[0] + 0.1, pair[1]
    valve = model(stick_band, slip_jump)
    op = 3.0 + wiggle * valve.static_friction * 0.99
    stem = valve.simulate(op, 3.0)
    np.testing.assert_allclose(stem, 3.0, atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
@given(op=signals)
@settings(max_examples=30, deadline=None)
def test_a_healthy_valve_follows(model, op):
    valve = (
        SemiPhysicalValve(0.0, 0.0, overshoot=1.0)
        if model is SemiPhysicalValve
        else model(0.0, 0.0)
    )
    np.testing.assert_allclose(valve.simulate(op, float(op[0])), op, atol=1e-3)


@given(op=signals, stick_band=st.floats(0.01, 20.0))
@settings(max_examples=80, deadline=None)
def test_kano_without_slip_jump_is_he_without_slip_jump(op, stick_band):
    kano = KanoValve(stick_band, 0.0).simulate(op, float(op[0]))
    he = HeValve(stick_band, 0.0).simulate(op, float(op[0]))
    np.testing.assert_allclose(kano, he, atol=1e-9)


@given(op=signals, pair=pairs)
@settings(max_examples=60, deadline=None)
def test_semi_physical_without_inertia_is_he(op, pair):
    plain = SemiPhysicalValve(*pair, overshoot=1.0).simulate(op, float(op[0]))
    np.testing.assert_allclose(plain, HeValve(*pair).simulate(op, float(op[0])), atol=1e-9)


def test_moving_kano_follows_a_slow_ramp_where_he_sticks_and_slips():
    ramp = np.arange(0.0, 10.0, 0.1)
    kano = KanoValve(4.0, 2.0).simulate(ramp, 0.0)
    he = HeValve(4.0, 2.0).simulate(ramp, 0.0)
    moved = int(np.argmax(kano > 0.0))
    assert ramp[moved] == pytest.approx(3.1)  # fS = 3
    np.testing.assert_allclose(kano[moved:], ramp[moved:] - 1.0)  # fD = 1
    slips = np.flatnonzero(np.diff(he))
    assert (np.diff(slips) > 15).all()  # the next slip needs J = 2, twenty samples


def test_reversal_needs_the_stick_band_and_going_on_needs_the_slip_jump():
    """The kinks of the phase plot that S and J are named after (Choudhury et al., 2005)."""
    down = 9.99 - np.arange(0.0, 6.0, 0.01)
    op = np.concatenate([np.arange(0.0, 10.0, 0.01), down])
    for model in (KanoValve, ChoudhuryValve):
        stem = model(5.0, 2.0).simulate(op, 0.0)
        held = op[1000:][stem[1000:] == stem[999]]
        assert held.max() - held.min() == pytest.approx(5.0, abs=0.03), model
    paused = np.concatenate(
        [np.arange(0.0, 10.0, 0.01), np.full(5, 9.99), np.arange(10.0, 14.0, 0.01)]
    )
    for model in (KanoValve, ChoudhuryValve):
        stem = model(5.0, 2.0).simulate(paused, 0.0)
        held = paused[1000:][stem[1000:] == stem[999]]
        assert held.max() - held.min() == pytest.approx(2.0, abs=0.03), model


def test_a_noisy_op_holds_choudhurys_valve_longer_than_kanos():
    rng = np.random.default_rng(3)
    op = np.linspace(0.0, 20.0, 400) + rng.normal(0.0, 0.3, 400)
    kano = np.count_nonzero(np.diff(KanoValve(3.0, 1.0).simulate(op, 0.0)))
    choudhury = np.count_nonzero(np.diff(ChoudhuryValve(3.0, 1.0).simulate(op, 0.0)))
    assert choudhury < kano


def test_undamped_stem_travels_twice_as_far():
    stem = SemiPhysicalValve.from_friction(3.0, 1.0).simulate([0.0, 4.0], 0.0)
    assert stem[-1] == pytest.approx(1.99 * (4.0 - 1.0))


@pytest.mark.parametrize(
    ("make", "part"),
    [
        (lambda: HeValve(1.0, 2.0), "slip jump"),
        (lambda: KanoValve(float("nan"), 0.0), "finite"),
        (lambda: SmoothedValve(2.0, 1.0, tau=0.0), "tau"),
        (lambda: SemiPhysicalValve(2.0, 1.0, overshoot=3.0), "overshoot"),
        (lambda: HeValve(2.0, 1.0).simulate([1.0, float("nan")]), "sample 1"),
        (lambda: HeValve(2.0, 1.0).simulate([]), "shape"),
        (lambda: HeValve(2.0, 1.0).simulate([1.0], float("inf")), "stem0"),
    ],
)
def test_bad_input_is_refused_with_its_name(make, part):
    with pytest.raises(ValueError, match=part):
        make()
