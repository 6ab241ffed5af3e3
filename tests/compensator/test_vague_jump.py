"""Blocks whose window left J open: it trades against the gain, and the block's interval says so."""

from dataclasses import replace

import numpy as np
import pytest

from compensator import PiController, PiSettings, Supervisor, Uncertainty
from compensator.prediction import Prediction
from compensator.stem_tracking.friction import FrictionPrior
from compensator.stem_tracking.tracker_settings import TrackerSettings
from compensator.stem_tracking.tracking import NOISE_KINDS, TrackerBank
from fieldlink.lab.study.closed_loop import EXAMPLE_1, Plant
from loop_model import LoopModel, ProcessModel, ValveModel
from tests.compensator.supervised_loop import Loop
from tests.seeds import in_suite

VAGUE = Uncertainty(1.5, 1.5)
"""Of a block that states J within five of itself, at 90 %."""


def with_another_jump(factor: float) -> LoopModel:
    """Example 1 as a limit cycle at one set-point leaves it: J times the gain is right."""
    p, valve = EXAMPLE_1.process, EXAMPLE_1.valve
    b = tuple(value / factor for value in p.b)
    # the offset is PV's at OP 0, where the stem of a limit cycle is not
    offset = p.offset + (1.0 + sum(p.a)) * p.gain * 50.0 * (1.0 - 1.0 / factor)
    return LoopModel(
        ValveModel(valve.stick_band, factor * valve.slip_jump),
        ProcessModel(p.a, b, p.dead_time, offset, p.period),
    )


def compensate(seed: int, model: LoopModel) -> Loop:
    """Run Example 1 under its own controller, then with a block; require what it promises."""
    loop = Loop(seed)
    loop.run(400)
    loop.supervisor.offer(model, VAGUE)
    loop.run(500)
    stem = np.abs(np.diff(loop.stem))
    assert loop.supervisor.compensating
    assert stem[500:].sum() / 400 <= stem[:400].sum() / 400
    assert loop.std(500) <= 0.5 * loop.std(100, 400)
    return loop


@pytest.mark.parametrize("seed", in_suite(1, range(1, 9)))
@pytest.mark.parametrize("factor", in_suite(2, [0.6, 2.2, 1.6]))
def test_a_wrong_slip_jump_within_its_interval_moves_the_valve_no_more(
    factor: float, seed: int
) -> None:
    compensate(seed, with_another_jump(factor))


@pytest.mark.parametrize("seed", in_suite(2, range(1, 9)))
def test_a_dead_time_a_sample_too_long_is_not_taken_for_a_wrong_gain(seed: int) -> None:
    """S trades against the dead time: both slips of a stroke come later."""
    process = replace(EXAMPLE_1.process, dead_time=2)
    compensate(seed, LoopModel(ValveModel(10.2, 3.4), process))


def bank_of(valve: ValveModel, uncertainty: Uncertainty) -> list[tuple[float, float]]:
    friction = FrictionPrior(uncertainty=uncertainty)
    settings = TrackerSettings(
        NOISE_KINDS[0], friction=friction, late=(), restless=(), gains=(), jump_late=()
    )
    bank = TrackerBank(Prediction.of(EXAMPLE_1.process, "input"), valve, settings, NOISE_KINDS[:1])
    return [(t.valve.slip_jump / valve.slip_jump, t.settings.gain) for t in bank.trackers]


def test_other_slip_jumps_are_followed_as_far_as_the_interval_reaches() -> None:
    valve = ValveModel(11.0, 3.0)
    frictions = len(TrackerSettings(NOISE_KINDS[0]).frictions)
    assert len(bank_of(valve, Uncertainty())) == frictions
    assert len(bank_of(valve, Uncertainty(0.1, 0.1))) == frictions
    # a deviation of 20 % in J: 0.4 is three of them away, and the likelihood of that is e^-4.5
    wide = bank_of(valve, Uncertainty(0.3, 0.3))[frictions:]
    assert [factor for factor, _ in wide] == pytest.approx([0.4, 0.65, 1.6])
    # of 12 %: 0.4 is five away
    narrow = bank_of(valve, Uncertainty(0.18, 0.18))[frictions:]
    assert [factor for factor, _ in narrow] == pytest.approx([0.65])
    # a J near 0 that may be anything: up to S, by twice as much each, none below a twentieth of S
    anything = bank_of(ValveModel(6.25, 0.25), Uncertainty(1.2, 1.0))[frictions:]
    assert [factor for factor, _ in anything] == pytest.approx([1.6, 3.2, 6.4, 12.8])
    # J never exceeds S
    assert max(f for f, _ in bank_of(ValveModel(4.0, 3.0), Uncertainty(1.0, 1.0))) <= 4.0 / 3.0


def test_the_product_of_jump_and_gain_is_that_of_the_model() -> None:
    for jump, gain in bank_of(ValveModel(11.0, 3.0), VAGUE)[3:]:
        assert jump * gain == pytest.approx(1.0)


def test_with_a_larger_slip_jump_a_longer_dead_time_is_followed() -> None:
    friction = FrictionPrior(uncertainty=Uncertainty(1.2, 1.0))
    settings = TrackerSettings(NOISE_KINDS[0], friction=friction, restless=(), gains=())
    prediction, valve = Prediction.of(EXAMPLE_1.process, "input"), ValveModel(6.25, 0.25)
    own = prediction.dead_time
    bank = TrackerBank(prediction, valve, settings, NOISE_KINDS[:1])
    larger = [t for t in bank.trackers if t.settings.gain < 1.0]
    assert [round(t.valve.slip_jump, 2) for t in larger[::3]] == [0.4, 0.8, 1.6, 3.2]
    assert [t.prediction.dead_time - own for t in larger] == [0, 5, 10] * 4
    # a smaller J makes no such room, and a level has no slip that settles
    narrow = replace(settings, friction=FrictionPrior(uncertainty=Uncertainty(0.18, 0.18)))
    smaller = TrackerBank(prediction, ValveModel(11.0, 3.0), narrow, NOISE_KINDS[:1]).trackers
    late = {t.prediction.dead_time - own for t in smaller if t.settings.gain != 1.0}
    assert late == {0}


@pytest.mark.parametrize("seed", in_suite(2, range(4)))
def test_a_small_jump_with_too_short_a_dead_time_does_not_make_the_loop_hunt(seed: int) -> None:
    """A window of a long dead time may be read as a short one and a stem that goes along."""
    process = ProcessModel((-0.931,), (0.0759,), 11, -50.0 * 0.0759, 1.0)
    read = ProcessModel((-0.931,), (4.0 * 0.0759,), 3, -200.0 * 0.0759, 1.0)
    noise = np.random.default_rng(seed).normal(0.0, 0.1, 1300)
    supervisor = Supervisor(PiController(PiSettings(0.256, 12.3, 1.0)))
    plant, op = Plant(process, ValveModel(6.0, 2.0), 50.0, 49.0), 50.0
    error, stem = np.empty(1300), np.empty(1300)
    for k in range(1300):
        if k == 600:
            assert supervisor.offer(LoopModel(ValveModel(6.0, 0.5), read), Uncertainty(1.2, 1.1))
        sp = 2.6 if k >= 20 else 0.0
        op = supervisor.step(plant.pv + float(noise[k]), sp, op).op
        plant.step(op)
        error[k], stem[k] = plant.pv - sp, plant.stem
    # With longer dead times left out, all of four were given back, PV at 0.5 to 2.4 times.
    assert supervisor.compensating
    assert np.std(error[700:]) <= 0.5 * np.std(error[150:600])
    way = np.abs(np.diff(stem))
    assert way[700:].mean() <= way[150:600].mean()
