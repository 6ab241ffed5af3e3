"""The stem on pages and in reports begins where PV says that it stood."""

from __future__ import annotations

import numpy as np
import pytest

from fieldlink.stem_start import likeliest_start
from fieldlink.web.view.curves import stem_of
from loop_model import ValveModel

VALVE = ValveModel(6.0, 3.0)
JUDGED = {"verdict": "stiction", "stick_band": 6.0, "slip_jump": 3.0}


def limit_cycle(samples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """OP, PV and stem of a PI before a sticky valve and a lag of six samples, with noise."""
    rng = np.random.default_rng(8)
    op, pv, stem = np.empty(samples), np.empty(samples), np.empty(samples)
    position, level, integral = 50.0, 50.0, 50.0
    for k in range(samples):
        error = 55.0 - level
        integral += 0.9 * error / 6.0
        op[k] = integral + 0.9 * error
        position = VALVE.step(position, op[k])
        level += (1.0 - np.exp(-1.0 / 6.0)) * (position - level)
        stem[k], pv[k] = position, level + rng.normal(0.0, 0.05)
    return op, pv, stem


def moves(stem: np.ndarray) -> int:
    return int(np.count_nonzero(np.diff(stem)))


def test_a_cycle_seen_from_its_middle_has_its_stem() -> None:
    op, pv, stem = limit_cycle(700)
    flat, right = 0, 0
    for begin in range(200, 400, 7):
        window = slice(begin, begin + 300)
        flat += moves(VALVE.simulate(op[window], op[begin])) <= 1
        shown = stem_of(op[window].tolist(), JUDGED, pv=pv[window].tolist())
        assert shown is not None
        known = np.array([np.nan if x is None else x for x in shown])
        right += np.nanmean(np.abs(known - stem[window])) < 0.5
    assert flat > 10  # from the first OP it would rest in many windows
    assert right >= 27  # of 29


def test_where_no_place_explains_pv_there_is_none() -> None:
    op, _, _ = limit_cycle(500)
    pv = 50.0 + np.random.default_rng(2).normal(0.0, 1.0, op.size)
    assert stem_of(op.tolist(), JUDGED, pv=pv.tolist()) is None


@pytest.mark.parametrize("pv", [np.full(100, 50.0), np.full(100, np.nan), np.arange(100) % 2.0])
def test_at_rest_the_stem_is_where_op_is(pv: np.ndarray) -> None:
    op = np.full(100, 42.0)
    start = likeliest_start(
        lambda at: VALVE.simulate(op, at), op, pv, stick_band=6.0, slip_jump=3.0
    )
    assert start == 42.0


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_few_samples_tell_nothing(samples: int) -> None:
    op = np.linspace(40.0, 60.0, samples)
    start = likeliest_start(
        lambda at: VALVE.simulate(op, at), op, op, stick_band=6.0, slip_jump=3.0
    )
    assert start == 40.0
