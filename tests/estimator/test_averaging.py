"""Windows that are sampled far faster than the loop moves: found on averages."""

from __future__ import annotations

import math

import numpy as np
import pytest

from estimator import identify
from estimator.averaging import average, block_of
from estimator.monitoring.indices.wear import travel_and_turns
from estimator.settings import SETTINGS
from estimator.window import harmonise

FASTER = 16
"""Samples of the record for one of a record that is fast enough."""
SCREENING = SETTINGS.screening


def _oscillating(seed: int, *, sticky: bool) -> tuple[np.ndarray, np.ndarray]:
    """OP and PV of two lags (15 and 4) and a dead time of 3, in 500 times ``FASTER`` samples.

    PI controller, He's valve with S 8 and J 2, written out here: no code of the project.
    """
    rng = np.random.default_rng(seed)
    n, lag, second, dead = 600 * FASTER, 15 * FASTER, 4 * FASTER, 3 * FASTER
    slow, fast = math.exp(-1.0 / lag), math.exp(-1.0 / second)
    op, pv = np.empty(n), np.empty(n)
    stem, u, before, load, first, last = 50.0, 50.0, 0.0, 0.0, 0.0, 0.0
    pipe = [0.0] * dead
    for k in range(n):
        load = (1.0 - 0.02 / FASTER) * load + 0.05 / math.sqrt(FASTER) * rng.normal()
        pv[k] = 50.0 + last + load + 0.02 * rng.normal()
        error = 50.0 - pv[k]
        u += 1.4 * (error - before + error / (10 * FASTER))
        before = error
        op[k] = u
        if not sticky:
            stem = u
        elif abs(u - stem) > 5.0:
            stem = u - math.copysign(3.0, u - stem)
        pipe.append(stem - 50.0)
        first = slow * first + (1.0 - slow) * pipe.pop(0)
        last = fast * last + (1.0 - fast) * first
    return op[100 * FASTER :], pv[100 * FASTER :]


def test_a_valve_is_found_behind_a_dead_time_of_48_samples() -> None:
    op, pv = _oscillating(1, sticky=True)
    found = identify(op, pv, period=0.5)
    assert found.verdict.value == "stiction"
    assert found.stick_band.low <= 8.0 <= found.stick_band.high
    assert found.slip_jump.low <= 2.0 <= found.slip_jump.high
    assert (found.samples, found.period_s) == (op.size, 0.5)
    assert found.stem.shape == found.pv_model.shape == op.shape
    assert found.process.dead_time_samples > 20
    assert any("averages of 8 samples" in text for text in found.identifiability)
    # the model is one of every sample: the estimated stem makes PV with it
    assert found.model is not None
    assert found.model.process.period == 0.5
    made = found.model.process.simulate(found.stem)
    late = slice(op.size // 4, None)
    assert np.std(pv[late] - made[late]) < 0.35 * np.std(pv[late])


@pytest.mark.thorough
def test_the_gain_of_every_sample_is_found_for_twenty_seeds() -> None:
    # J trades against the gain from loop to loop: the median is what the model is worth
    errors = []
    for seed in range(1, 21):
        found = identify(*_oscillating(seed, sticky=True), period=0.5)
        if found.verdict.value == "stiction":
            assert found.model is not None
            errors.append(abs(found.model.process.gain - 1.0))
    assert len(errors) >= 10
    assert np.median(errors) < 0.2


def test_a_healthy_valve_is_not_accused() -> None:
    op, pv = _oscillating(2, sticky=False)
    assert identify(op, pv, period=0.5).verdict.value == "no_stiction"


def test_only_what_is_slow_and_quiet_is_averaged() -> None:
    k = np.arange(8000)
    slow = np.sin(2.0 * np.pi * k / 1600)
    assert block_of(slow, SCREENING) == 8
    assert block_of(slow[:1900], SCREENING) == 1
    assert block_of(np.sin(2.0 * np.pi * k / 50), SCREENING) == 1
    # a fast oscillation of a twentieth of the span under the slow one
    assert block_of(slow + 0.1 * np.sin(2.0 * np.pi * k / 40), SCREENING) == 1
    noise = np.random.default_rng(4).normal(size=k.size)
    assert block_of(slow + 0.004 * noise, SCREENING) == 8
    assert block_of(slow + 0.1 * noise, SCREENING) == 1


def test_turns_are_counted_beyond_a_least_size() -> None:
    signal = np.array([0.0, 1.0, 0.95, 2.0, 0.5, 0.6, 0.4, 1.4])
    assert travel_and_turns(signal, 0.2)[1] == 2
    assert travel_and_turns(signal, 0.07)[1] == 4
    assert travel_and_turns(np.linspace(0.0, 1.0, 9), 0.1)[1] == 0


def test_averages_leave_bad_samples_out() -> None:
    op = np.arange(12.0)
    pv = np.array([1.0, 1.0, 3.0, np.nan, np.nan, np.nan, 5.0, 7.0, 2.0, 2.0, 4.0, 4.0])
    window = harmonise(op, pv, None, None, 2.0, SCREENING)
    found = average(window, 3)
    assert found.period == 6.0
    assert found.good.tolist() == [True, False, True, True]
    np.testing.assert_allclose(found.op_centre + found.op_span * found.u, [1.0, 4.0, 7.0, 10.0])
    plant = found.pv_centre + found.pv_scale * found.y
    np.testing.assert_allclose(plant[found.good], [5.0 / 3.0, 14.0 / 3.0, 10.0 / 3.0])
