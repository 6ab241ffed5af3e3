"""OP that moves in steps is no hand's and at no limit; hands and limits are found all the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from benchmarks.diagnosis_families.tuning.hands import KINDS, HandRecord, draw_hand
from estimator.controller.controller import Controller
from estimator.diagnosis.causes import rank_causes
from estimator.diagnosis.facts import Limits, by_hand_of, limits_of
from estimator.diagnosis.gathered import Gathered
from estimator.diagnosis.loop_record import loop_record
from estimator.diagnosis.oscillation import detect_oscillation
from estimator.diagnosis.settings import DIAGNOSIS
from fieldlink.diagnosis import CauseName, diagnose, read_controller
from tests.closed_loop import run
from tests.seeds import few_and_all, in_suite

SEEDS = range(20)
STEPS = KINDS[1:]


def told(loop: HandRecord) -> tuple[np.ndarray, float]:
    """Samples that are called manual, ``(n,)``, and the share at a limit."""
    record = loop_record(loop.op, loop.pv, loop.sp, None, 1.0)
    controller = read_controller(loop.op, loop.pv, loop.sp)
    assert record.error is not None
    by_hand = by_hand_of(record.op, None, record.error, controller, DIAGNOSIS.facts)
    limits = limits_of(record.op, record.error, controller, by_hand, DIAGNOSIS.facts)
    return by_hand, limits.share


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seeds", few_and_all(10, SEEDS))
def test_op_in_automatic_is_neither_by_hand_nor_at_a_limit(kind: str, seeds: Sequence[int]) -> None:
    wrong = 0
    for seed in seeds:
        by_hand, limited = told(draw_hand(kind, seed))
        wrong += by_hand.mean() > 0.05 or limited > 0.02
    assert wrong <= 0.1 * len(seeds)


@pytest.mark.parametrize("share", in_suite(1, [0.2, 0.06, 0.4]))
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seeds", few_and_all(10, SEEDS))
def test_a_hand_that_holds_op_is_found_without_a_mode(
    kind: str, share: float, seeds: Sequence[int]
) -> None:
    found = 0
    for seed in seeds:
        loop = draw_hand(kind, seed, share=share)
        by_hand, _ = told(loop)
        found += np.mean(by_hand[loop.by_hand]) > 0.8
    assert found >= (1.0 if kind == "continuous" else 0.65) * len(seeds)


def test_a_hand_that_moves_op_a_few_times_is_found_beside_a_continuous_op() -> None:
    shares = []
    for seed in SEEDS:
        loop = draw_hand("continuous", seed, share=0.9, moves=12)
        shares.append(told(loop)[0].mean())
    assert min(shares) > 0.3


@pytest.mark.parametrize("kind", ["continuous", "three-point", "coarse"])
def test_a_limit_is_found_however_op_moves(kind: str) -> None:
    assert sum(told(draw_hand(kind, seed, limit=True))[1] > 0.02 for seed in SEEDS) >= 19


@pytest.mark.parametrize("kind", STEPS)
def test_what_may_be_a_hand_is_never_called_quiet(kind: str) -> None:
    for seed in range(6):
        loop = draw_hand(kind, seed, share=0.9, moves=12)
        answer = diagnose(loop.op, loop.pv, loop.sp, advice=False, figures=False)
        assert answer.first.name is not CauseName.QUIET


@pytest.mark.parametrize("seed", in_suite(3, [1, 2, 3, 5, 6, 7]))
def test_op_that_answers_no_error_is_not_called_quiet(seed: int) -> None:
    # a hand moves OP every few samples: no run is long enough to be held
    rng = np.random.default_rng(seed)
    op = 50.0 + np.cumsum(np.where(rng.random(1200) < 0.15, rng.standard_normal(1200), 0.0)) * 0.3
    pv, y, load = [], 0.0, 0.0
    for u, (noise, push) in zip(op, rng.standard_normal((1200, 2)), strict=True):
        load = 0.97 * load + 0.3 * push
        y += (1.2 * (u - 50.0 + load) - y) / 12.0
        pv.append(50.0 + y + 0.02 * noise)
    answer = diagnose(op, np.array(pv), np.full(1200, 50.0), period=1.0, advice=False)
    assert answer.controller is None
    assert CauseName.QUIET not in {cause.name for cause in answer.causes}


def test_values_that_a_hand_sets_one_after_the_other_are_no_limits() -> None:
    for seed in range(3):
        loop = run(seed=seed)
        op, n = loop.op.copy(), loop.op.size
        values = np.random.default_rng(seed).permutation([-8.0, -4.0, -2.0, 3.0, 6.0, 8.0])
        op[300:] = np.repeat(50.0 + values, 200)
        answer = np.zeros(n)
        for k in range(4, n):
            answer[k] = answer[k - 1] + 0.08 * (1.5 * (op[k - 4] - 50.0) - answer[k - 1])
        pv = np.where(np.arange(n) < 300, loop.pv, 50.0 + answer)
        pv += 0.05 * np.random.default_rng(seed).standard_normal(n)
        found = diagnose(op, pv, loop.sp, period=1.0, advice=False)
        assert [cause.name for cause in found.causes] == ["manual"]


@pytest.mark.parametrize(("explained", "name"), [(0.4, "undetermined"), (0.99, "quiet")])
def test_a_gain_that_explains_little_of_op_is_no_controller_of_a_quiet_loop(
    explained: float, name: str
) -> None:
    rng = np.random.default_rng(5)
    values = rng.standard_normal(600)
    gain = Controller("P", 1.0, np.inf, 0.0, 0.0, 0.0, "error", 0, explained, False)
    still = Limits(0.0, 0.0, False, False, np.nan, np.zeros(600, dtype=bool))
    swing = detect_oscillation(values, period=1.0)
    assert not swing.present
    facts = Gathered(swing=swing, signal="error", limits=still, has_pv=True, controller=gain)
    assert rank_causes(facts, DIAGNOSIS)[0].name == name
