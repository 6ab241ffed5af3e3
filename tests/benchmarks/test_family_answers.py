"""Counts of verdicts, classes of recorded windows and the ways a record is thinned."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.compression import STORES, store
from benchmarks.families.report import draw
from benchmarks.family_answers import Answer, count, loops_of
from benchmarks.recorded import Labelled
from benchmarks.recorded_loops import area_of, class_of
from tests.seeds import in_suite

NOTHING = (math.nan, math.nan, math.nan)


def _answer(sticky, verdict, *, uncertain=False, assessable=True, band=NOTHING):
    return Answer(
        kind="pi",
        law="he" if sticky else "none",
        seed=1,
        is_sticky=sticky,
        is_assessable=assessable,
        verdict=verdict,
        is_uncertain=uncertain,
        score=0.0,
        reasons=(),
        true_band=4.0 if sticky else 0.0,
        true_jump=1.0 if sticky else 0.0,
        band=band,
        jump=(1.0, 0.0, 2.0),
        milliseconds=10.0,
    )


def test_an_uncertain_answer_is_half_an_error_and_a_declined_one_none():
    counts = count(
        [
            _answer(False, "stiction"),
            _answer(False, "stiction", uncertain=True),
            _answer(False, "no_stiction"),
            _answer(True, "no_stiction", uncertain=True),
            _answer(True, "not_assessable"),
            _answer(True, "no_stiction"),
        ]
    )
    assert counts.errors == 3.0
    assert (counts.accused, counts.healthy_uncertain) == (1, 1)
    assert (counts.missed, counts.sticky_uncertain, counts.sticky_declined) == (1, 1, 1)


def test_a_record_that_cannot_tell_is_counted_apart():
    counts = count([_answer(True, "no_stiction", assessable=False), _answer(False, "no_stiction")])
    assert (counts.sticky, counts.hopeless, counts.errors) == (0, 1, 0.0)


def test_coverage_and_errors_are_of_loops_called_sticky():
    found = [
        _answer(True, "stiction", band=(5.0, 4.5, 5.5)),
        _answer(True, "stiction", band=(4.0, 3.0, 5.0)),
        _answer(True, "no_stiction", band=(9.0, 8.0, 9.5)),
    ]
    counts = count(found)
    assert counts.band_coverage == 0.5
    assert counts.band_error == pytest.approx(0.125)
    assert counts.jump_coverage == 1.0


def test_every_kind_gives_as_many_loops_healthy_and_sticky_where_it_has_both():
    loops = loops_of(["pi", "he", "tight-tuning"], 3, 100)
    assert len(loops) == 12
    assert ("he", False, 100) not in loops
    assert ("tight-tuning", True, 100) not in loops


def _window(op, pv, file="x.csv"):
    return Labelled(
        file=file, loop="l", kind="flow", label="stiction", index=None, period_s=1.0, begun=None,
        op=op, pv=pv, sp=None, auto=None,
    )  # fmt: skip


def test_a_window_at_a_rail_cannot_be_labelled():
    swing = np.sin(np.arange(600) / 20.0)
    assert class_of(_window(swing, swing)) == "agreed"
    assert class_of(_window(swing, np.maximum(swing, 0.1))) == "not assessable"
    assert class_of(_window(np.ones(600), swing)) == "not assessable"
    assert class_of(_window(swing, swing, "plant_14.csv")) == "disputed"


def test_an_area_has_an_interval_only_where_there_are_loops_to_draw():
    scores, sticky = [3, 3, 3, 3, 1, 2, 4, 1], [True] * 4 + [False] * 4
    many = area_of(scores, sticky, list("abcdefgh"))
    one_sticky_loop = area_of(scores, sticky, list("aaaabcde"))
    assert many.value == one_sticky_loop.value == 0.75
    assert many.low < many.value < many.high
    assert math.isnan(one_sticky_loop.low)
    assert math.isnan(area_of([1.0], [True], ["a"]).value)


@pytest.mark.parametrize("how", in_suite(5, STORES))
def test_a_stored_record_keeps_the_truth_and_loses_samples(how):
    loop = draw("pi", True, 5000)
    kept_loop, kept = store(loop, how)
    assert kept_loop.stick_band == loop.stick_band
    assert kept <= loop.pv.size / loop.strokes
    if how[0] == "sampled":
        assert kept_loop.period >= loop.period
        assert kept_loop.op.size == pytest.approx(kept * loop.strokes, abs=1.0)
    elif how[0] == "door":
        assert np.abs(kept_loop.pv - loop.pv).max() <= how[1] * loop.pv.std() + 1e-9
