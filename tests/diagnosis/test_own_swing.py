"""A loop that seems to swing by itself where no oscillation is seen, and what swings it as well."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from estimator.diagnosis.causes import rank_causes
from estimator.diagnosis.explanations import Explained
from estimator.diagnosis.facts import Limits
from estimator.diagnosis.gathered import Gathered
from estimator.diagnosis.linear_loop import LinearLoop
from estimator.diagnosis.oscillation import Oscillation, detect_oscillation
from estimator.diagnosis.settings import DIAGNOSIS
from fieldlink.diagnosis import Controller, diagnose
from loop_model import ProcessModel
from tests.closed_loop import run

POLE = math.exp(-1.0 / 12.0)
PROCESS = ProcessModel((-POLE,), (1.5 * (1.0 - POLE),), 4, 0.0, 1.0)
"""A lag of 12 samples; under `CONTROLLER` its Ms is 9."""
CONTROLLER = Controller("PI", 3.0, 12.0, 0.0, 3.0 / 12.0, 0.0, "error", 0, 1.0, True)


def still() -> Oscillation:
    swing = detect_oscillation(np.random.default_rng(5).standard_normal(600), period=1.0)
    assert not swing.present
    return swing


def facts(process: float, outside: float) -> Gathered:
    """A loop whose process has that evidence, and a wave from outside this one, in nats."""
    explained = Explained((), -12.0, outside, 0.0, process, PROCESS, np.zeros(1), 0.0, 0.0, 0.0, 0)
    loop = LinearLoop.of(PROCESS, CONTROLLER)
    return Gathered(
        swing=still(),
        signal="error",
        limits=Limits(0.0, 0.0, False, False, math.nan, np.zeros(600, dtype=bool)),
        has_pv=True,
        controller=CONTROLLER,
        explained=explained,
        loop=loop,
        predictable=(0.95, 0.9),
        samples=1500,
        ask_headroom=lambda: 0.99,
    )


@pytest.mark.parametrize(
    ("wave", "name"),
    [
        (math.nan, "tight_tuning"),
        (-14.0, "tight_tuning"),
        (-6.0, "undetermined"),
        (9.0, "undetermined"),
    ],
)
def test_a_swing_that_nobody_sees_is_the_loop_s_where_a_wave_is_surely_less_likely(
    wave: float, name: str
) -> None:
    found = replace(facts(process=60.0, outside=-math.inf), ask_own_wave=lambda: wave)
    assert found.loop is not None
    assert found.loop.margins().sensitivity > 4.4
    causes = rank_causes(found, DIAGNOSIS)
    # neither slow, whatever room there seems to be
    assert [cause.name for cause in causes] == [name]
    if name == "undetermined":
        assert "a tight loop or a wave" in causes[0].evidence[0]


@pytest.mark.parametrize(
    ("process", "wanders", "name"),
    [(5.0, 0.4, "undetermined"), (5.0, 0.1, "external_oscillation"),
     (60.0, 0.4, "external_oscillation")],
)  # fmt: skip
def test_a_process_that_hardly_shows_does_not_clear_a_loop_whose_swing_wanders(
    process: float, wanders: float, name: str
) -> None:
    # the swing is far slower than the loop's own: the loop does not amplify it
    swing = replace(
        still(), present=True, period_s=300.0, cycles=20.0, regularity=20.0, decay=0.9, share=0.9
    )
    found = replace(
        facts(process, outside=4.0), swing=swing, amplitude=wanders, in_phase=0.9,
        predictable=(0.0, 0.0), swing_share=0.9, ask_headroom=lambda: 0.0,
    )  # fmt: skip
    assert found.amplification()[0] < DIAGNOSIS.judging.tight
    assert rank_causes(found, DIAGNOSIS)[0].name == name


@pytest.mark.parametrize(
    ("period", "size", "gain", "lag", "seed"),
    [(49.25, 0.442, 0.959, 20.0, 167), (47.56, 0.411, 0.589, 20.0, 233)],
)
def test_a_small_wave_through_a_well_tuned_loop_is_no_tight_tuning(
    period: float, size: float, gain: float, lag: float, seed: int
) -> None:
    wave = size * np.sin(2.0 * np.pi * np.arange(1500) / period)
    loop = run(gain=gain, integral_time=lag, lag=lag, load=wave, noise=0.05, seed=seed)
    answer = diagnose(loop.op, loop.pv, loop.sp, period=1.0, advice=False)
    assert not answer.oscillation.present
    assert answer.first.name == "undetermined"
    assert "a tight loop or a wave" in answer.first.evidence[0]


@pytest.mark.parametrize(
    ("explained", "gap", "unlike", "name"),
    [(1.0, math.nan, 0.0, "external_oscillation"), (0.56, math.nan, 0.0, "undetermined"),
     (1.0, 0.1, 0.0, "undetermined"), (0.56, math.nan, 30.0, "external_oscillation"),
     (1.0, 0.1, 30.0, "undetermined")],
)  # fmt: skip
def test_a_controller_that_is_hardly_read_or_has_a_gap_clears_no_loop_of_its_swing(
    explained: float, gap: float, unlike: float, name: str
) -> None:
    # nothing shows a wave but that the loop, were it of this controller, would not swing
    swing = replace(
        still(), present=True, period_s=300.0, cycles=20.0, regularity=100.0, decay=0.9, share=0.9
    )
    found = replace(
        facts(process=60.0, outside=-20.0), swing=swing, amplitude=0.1, in_phase=0.9, gap=gap,
        unlike_noise=unlike, controller=replace(CONTROLLER, explained=explained),
        predictable=(0.0, 0.0), swing_share=0.9, ask_headroom=lambda: 0.0,
    )  # fmt: skip
    cause = rank_causes(found, DIAGNOSIS)[0]
    assert cause.name == name
    if name == "undetermined":
        assert ("gap" if math.isfinite(gap) else "explain 56% of OP's moves") in cause.evidence[1]
