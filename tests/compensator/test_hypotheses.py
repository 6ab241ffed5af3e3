"""The hypotheses on a stem: what a command and a PV make of them, and which are kept."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from compensator.prediction import Prediction
from compensator.stem_tracking.friction import FrictionPrior
from compensator.stem_tracking.hypotheses import Hypotheses
from compensator.stem_tracking.hypothesis_kernels import (
    COLUMNS,
    DIRECTION,
    NOISE,
    PRIOR,
    SCORE,
    STEM,
    SURVIVED,
    TESTED,
    correct,
    keep_likely,
    move,
)
from compensator.stem_tracking.tracker_settings import TrackerSettings
from compensator.stem_tracking.tracking import NOISE_KINDS
from loop_model import ProcessModel, ValveModel

PRIOR_OF_FRICTION = FrictionPrior()
LAW = PRIOR_OF_FRICTION.law(negligible=0.006)
A, B, NO_NOISE = np.ones((1, 1)), np.zeros(1), np.zeros(1)
SETTINGS = TrackerSettings(NOISE_KINDS[0])
RANKING = (SETTINGS.alike, SETTINGS.hopeless, SETTINGS.hypotheses)


def table(*rows: tuple[float, float, tuple[float, ...]]) -> tuple[np.ndarray, np.ndarray]:
    """Hypotheses of a process with one state: stem, score, point; with room for more."""
    values, points = np.zeros((20, COLUMNS)), np.zeros((20, 4))
    values[:, [SURVIVED, TESTED]] = -math.inf
    for k, (stem, score, point) in enumerate(rows):
        values[k, [STEM, DIRECTION, SCORE]] = stem, 1.0, score
        points[k] = point
    return values, points


def moved(
    values: np.ndarray, points: np.ndarray, count: int, op: float
) -> tuple[int, bool, np.ndarray]:
    """Move a valve of fS = 5 and fD = 2 whose static friction has a deviation of 0.5."""
    spread = np.zeros((4, 4))
    count, merged = move(
        values, points, count, op, 5.0, 2.0, 0.5, LAW, A, B, NO_NOISE, *RANKING, spread
    )
    return count, merged, spread


def test_a_command_that_missed_makes_the_next_one_stronger() -> None:
    """What the stem has withstood is claimed on, and paid for by the prior of the friction."""
    values, points = table((50.0, 0.0, (0.0, 0.0, 0.0, 0.0)))
    count, _, _ = moved(values, points, 1, op=56.0)  # two deviations above fS
    assert count == 2
    stayed = int(np.flatnonzero(values[:2, STEM] == 50.0)[0])
    slipped = 1 - stayed
    assert values[slipped, STEM] == 54.0
    assert values[stayed, SURVIVED] == values[stayed, TESTED] == 2.0
    claim = math.log(0.95 * norm.sf(2.0) + 0.05 * norm.sf(0.5))
    assert values[stayed, PRIOR] == pytest.approx(claim)
    assert values[stayed, SCORE] == pytest.approx(2.0 * claim)  # it has happened, and is claimed

    values, points = table((50.0, claim, (0.0, 0.0, 0.0, 0.0)))
    values[0, [PRIOR, SURVIVED, TESTED]] = claim, 2.0, 2.0
    assert moved(values, points, 1, op=60.0)[0] == 1
    assert values[0, [STEM, SURVIVED, TESTED]].tolist() == [58.0, 1.9, -math.inf]


def test_a_pv_that_tells_hypotheses_apart_lets_older_evidence_fade_but_not_the_prior() -> None:
    gain = np.array([0.5, 0.1, 0.0, 0.0])
    values, points = table((50.0, 3.0, (0.0,) * 4), (60.0, 2.5, (2.0, 0.0, 0.0, 0.0)))
    values[:, PRIOR] = -1.0
    count, surprise = correct(
        values, points, 2, 1.0, 2.0, 9.0, gain, 0.25, 60.0, 1.0, -0.5, 0.5, *RANKING
    )
    # Both are off by one: nothing is told, nothing fades.
    assert (count, surprise) == (2, 1.0)
    assert values[:2, SCORE].tolist() == [3.0, 2.5]
    assert points[:2, :2].tolist() == [[0.5, 0.1], [1.5, -0.1]]
    assert values[:2, NOISE].tolist() == [0.25, -0.25]
    correct(values, points, 2, 0.5, 2.0, 9.0, gain, 0.25, 60.0, 1.0, -0.5, 0.5, *RANKING)
    # The second is off by one: half a squared deviation, of a variance of 2.
    keep = 1.0 - (1.0 - math.exp(-0.25)) / 60.0
    assert values[:2, SCORE] == pytest.approx([-1.0 + 4.0 * keep, -1.0 + 3.5 * keep - 0.25])


def test_hypotheses_that_agree_on_the_stem_are_merged_by_their_moments() -> None:
    values, points = table(
        (48.0, math.log(0.75), (1.0, 2.0, 0.0, 0.0)),
        (49.0, math.log(0.25), (5.0, -2.0, 0.0, 0.0)),
        (59.0, -1.0, (0.0, 0.0, 0.0, 0.0)),
    )
    count, merged, spread = moved(values, points, 3, op=60.0)
    assert values[:count, STEM].tolist() == [58.0, 59.0]
    assert values[:count, SCORE] == pytest.approx([0.0, -1.0])
    assert points[0] == pytest.approx([2.0, 1.0, 0.0, 0.0])
    assert merged
    assert spread[:2, :2] == pytest.approx(np.array([[3.0, -3.0], [-3.0, 3.0]]))
    assert not moved(values, points, count, op=60.0)[1]


def test_of_two_positions_that_are_alike_the_present_one_is_kept() -> None:
    def ranked(second: float, alike: float) -> list[float]:
        values, points = table((50.0, -3.0, (0.0,) * 4), (52.0, second, (0.0,) * 4))
        count, _ = keep_likely(values, points, 2, alike, *RANKING[1:])
        return list(values[:count, STEM])

    assert ranked(-3.0 + 1e-9, SETTINGS.alike) == [50.0, 52.0]
    assert ranked(-1.0, SETTINGS.alike) == [52.0, 50.0]
    assert ranked(-3.0 + 1e-9, 0.0) == [52.0, 50.0]


def test_hopeless_and_repeated_hypotheses_and_too_many_are_dropped() -> None:
    points = (0.0,) * 4
    values, at = table(
        (50.0, 0.0, points), (50.0, -1.0, points), (52.0, -14.9, points), (54.0, -15.1, points)
    )
    count, first = keep_likely(values, at, 4, *RANKING)
    assert (values[:count, STEM].tolist(), first) == ([50.0, 52.0], 0)
    values, at = table(*((50.0 + k, -0.1 * k, points) for k in range(10)))
    assert keep_likely(values, at, 10, 0.01, 15.0, 3)[0] == 3


def test_earlier_positions_are_believed_again_where_op_would_not_have_moved_the_stem() -> None:
    process = ProcessModel((-0.9,), (0.1,), 2, 0.0, 1.0)
    hypotheses = Hypotheses(Prediction.of(process, "input"), SETTINGS)
    hypotheses.start(0.0, 50.0, ValveModel(0.0, 0.0))
    assert hypotheses.stems == [50.0]
    hypotheses.recall([(50.0, 1.0), (53.0, -1.0), (70.0, 1.0)], op=51.0, reach=5.0)
    assert hypotheses.stems == [50.0, 53.0]
    assert hypotheses.chances[1] == pytest.approx(1.0 / (1.0 + math.exp(SETTINGS.recalled)))
    assert hypotheses.belief(1).direction == -1.0
    with pytest.raises(IndexError, match="there are 2 hypotheses; got rank 2"):
        hypotheses.belief(2)
