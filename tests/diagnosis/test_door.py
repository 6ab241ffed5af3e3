"""What `diagnose` does with too short, misplaced, masked and wrong signals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from estimator import EstimatorError, Verdict, identify
from fieldlink.diagnosis import diagnose
from tests.closed_loop import run
from tests.seeds import few_and_all, in_suite


@pytest.mark.parametrize("samples", in_suite(3, [20, 50, 80, 35, 55, 60]))
@pytest.mark.parametrize("seeds", few_and_all(3, range(10)))
def test_a_short_record_has_an_answer(samples: int, seeds: Sequence[int]) -> None:
    # its past is shorter than the long noise model of the advice
    for seed in seeds:
        loop = run(seed=seed, n=200, gain=1.6)
        part = slice(100, 100 + samples)
        found = diagnose(loop.op[part], loop.pv[part], loop.sp[part])
        assert found.causes


@pytest.mark.parametrize("late", [1, 2])
def test_pv_that_is_stored_late_is_read_as_the_controller_saw_it(late: int) -> None:
    loop = run(band=4.0, jump=2.0, noise=0.1)
    pv = np.concatenate([np.full(late, loop.pv[0]), loop.pv[:-late]])
    found = diagnose(loop.op, pv, loop.sp, advice=False)
    assert found.first.name == "sticky_valve"
    assert found.controller is not None
    assert found.controller.exact
    assert found.controller.gain == pytest.approx(0.8, rel=1e-6)
    assert found.controller.integral_time_s == pytest.approx(12.0, rel=1e-6)


def test_one_lost_sample_leaves_the_controller_exact() -> None:
    loop = run()
    pv = loop.pv.copy()
    pv[700] = np.nan
    found = diagnose(loop.op, pv, loop.sp, advice=False)
    assert found.controller is not None
    assert found.controller.explained == pytest.approx(1.0, abs=1e-9)


def test_what_is_masked_is_no_sample() -> None:
    loop = run(band=4.0, jump=2.0)
    bad = np.arange(1500) % 7 == 0
    spoiled = np.where(bad, -9999.0, loop.pv)
    masked = np.ma.array(spoiled, mask=bad)
    hidden = np.where(bad, np.nan, loop.pv)
    assert identify(loop.op, masked).score == identify(loop.op, hidden).score
    assert identify(loop.op, masked).verdict is Verdict.STICTION
    assert diagnose(loop.op, masked, advice=False).to_dict() == (
        diagnose(loop.op, hidden, advice=False).to_dict()
    )


@pytest.mark.parametrize(
    ("more", "word"),
    [
        ({"auto": ["AUTO"] * 1500}, "auto is not numeric"),
        ({"period": "1"}, "period is '1'"),
        ({"period": 0.0}, "period is 0.0"),
        ({"sp": [1.0]}, "sp has 1"),
    ],
)
def test_what_is_no_signal_is_named(more: dict[str, object], word: str) -> None:
    loop = run()
    for ask in (diagnose, identify):
        with pytest.raises(EstimatorError, match=word):
            ask(loop.op, loop.pv, **more)  # type: ignore[operator]


@pytest.mark.parametrize("size", [0, 1, 10])
def test_a_record_of_a_few_samples_is_too_short(size: int) -> None:
    row = np.arange(float(size))
    with pytest.raises(EstimatorError, match=f"a record of {size} samples is too short: give 20"):
        diagnose(row, row[::-1])


def test_a_signal_without_samples_is_named() -> None:
    with pytest.raises(EstimatorError, match="pv has no finite sample"):
        diagnose(np.arange(100.0), np.full(100, np.nan))


def test_whatever_is_not_zero_is_automatic() -> None:
    # True is -1 in some PLCs and databases.
    loop = run(band=4.0, jump=2.0, n=600)
    flags = np.where(np.arange(600) < 150, 0.0, -1.0)
    told = [diagnose(loop.op, loop.pv, auto=one, advice=False) for one in (flags, -flags)]
    assert told[0].to_dict() == told[1].to_dict()


def test_a_record_that_keeps_each_value_is_diagnosed_on_each_value_once() -> None:
    loop = run(band=4.0, jump=2.0, n=600)
    held = [np.repeat(one, 4) for one in (loop.op, loop.pv, loop.sp)]
    found, once = diagnose(*held), diagnose(loop.op, loop.pv, loop.sp, period=4.0)
    assert [cause.to_dict() for cause in found.causes] == [one.to_dict() for one in once.causes]
    assert found.oscillation == once.oscillation
    assert "keeps each value for 4 samples" in found.notes[-1]


def test_every_cause_says_what_to_do_and_a_result_is_shown_without_its_samples() -> None:
    loop = run(band=4.0, jump=2.0)
    found = diagnose(loop.op, loop.pv, loop.sp, advice=False)
    assert "packing" in found.first.action
    assert all(cause.action for cause in found.causes)
    assert len(repr(identify(loop.op, loop.pv))) < 4000
