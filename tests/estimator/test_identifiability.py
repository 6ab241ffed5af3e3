"""What a window cannot tell, and what else explains it, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from scipy.signal import lfilter

from estimator import Verdict, identify
from estimator.estimate import Estimate
from estimator.identifiability import identifiability
from estimator.intervals.posterior import Peak
from estimator.result import Interval, Process
from loop_model import ProcessModel
from tests.seeds import few_and_all

UNKNOWN = Interval.unknown()
SHARP = Estimate(
    criterion="arx",
    reason="as asked",
    band=Interval(0.5, 0.49, 0.51),
    jump=Interval(0.2, 0.18, 0.22),
    static=UNKNOWN,
    dynamic=UNKNOWN,
    stem=np.zeros(1),
    simulated=np.zeros(1),
    process=Process("none", MappingProxyType({}), 1, UNKNOWN),
    model=ProcessModel((-0.5,), (0.5,), 1, 0.0, 1.0),
    peaks=(Peak(0.5, 0.2, 1.0),),
)


def test_a_sharp_window_needs_no_words() -> None:
    assert identifiability(SHARP, 20.0, sticky=True) == ()
    near = (Peak(0.5, 0.2, 0.6), Peak(0.515, 0.2, 0.4))
    assert identifiability(replace(SHARP, peaks=near), 20.0, sticky=True) == ()


def test_two_valves_that_explain_the_window_are_named() -> None:
    two = (Peak(0.5, 0.2, 0.62), Peak(0.35, 0.25, 0.38))
    (said,) = identifiability(replace(SHARP, peaks=two), 20.0, sticky=True)
    assert said == (
        "different valves explain this window about equally well: S 10 with J 4 (62 %), "
        "or S 7 with J 5 (38 %)"
    )


def test_vague_parameters_are_called_vague() -> None:
    vague = replace(SHARP, band=Interval(0.5, 0.3, 0.7), jump=Interval(0.1, 0.0, 0.3))
    band, jump = identifiability(vague, 10.0, sticky=True)
    assert band.startswith("the stick band is vague in this window: anything from 3 to 7")
    assert jump.startswith("the slip jump cannot be identified from this window: any value below 3")
    (said,) = identifiability(replace(SHARP, jump=Interval(0.2, 0.12, 0.3)), 10.0, sticky=True)
    assert said.startswith("the slip jump is vague in this window: anything from 1.2 to 3")


def test_a_healthy_valve_needs_no_words_either() -> None:
    vague = replace(SHARP, band=Interval(0.5, 0.3, 0.7), jump=Interval(0.1, 0.0, 0.3))
    assert identifiability(vague, 10.0, sticky=False) == ()


@pytest.mark.parametrize(
    ("criterion", "words"), [("auto", "by BIC"), ("oe", "as asked"), ("arx", "as asked")]
)
def test_a_result_says_why_it_is_under_its_criterion(sticky_window, criterion, words) -> None:
    found = identify(*sticky_window[:2], criterion=criterion)
    assert words in found.criterion_reason
    assert found.criterion == ("arx" if criterion == "arx" else "oe")


def test_runners_up_are_in_order_and_behind(sticky_window) -> None:
    found = identify(*sticky_window[:2]).runners_up
    behind = [one.behind for one in found]
    assert behind == sorted(behind)
    assert behind[0] > 0.0
    assert "healthy valve" in {one.explanation for one in found}


@pytest.mark.parametrize("seeds", few_and_all(6, range(20)))
def test_pv_that_has_nothing_to_do_with_op_is_seldom_followed(seeds: Sequence[int]) -> None:
    # the likeliest of a thousand processes fits a little of any PV that wanders
    verdicts = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        op = lfilter([1.0], [1.0, -0.97], rng.normal(size=600))
        pv = lfilter([1.0], [1.0, -0.8], rng.normal(size=600))
        verdicts.append(identify(op, pv).verdict)
    assert verdicts.count(Verdict.NOT_ASSESSABLE) >= 0.75 * len(seeds)
    assert Verdict.STICTION not in verdicts
