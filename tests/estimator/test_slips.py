"""The walk from slip to slip against the valve's equation, and the listing of all its sets."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from estimator._listing import slip_patterns
from estimator._one_step import one_step_costs
from estimator._slips import Op, op_of, slips
from estimator.arx import ArxOrders, ArxRegression
from estimator.candidate import Candidate, stem_of
from estimator.structures import COARSE
from loop_model import ValveModel


def _op(seed: int, n: int = 200) -> Op:
    u = np.cumsum(np.random.default_rng(seed).normal(size=n))
    return op_of((u - u.mean()) / np.ptp(u))


@given(
    seed=st.integers(0, 200),
    band=st.floats(0.02, 1.0),
    ratio=st.floats(0.0, 1.0),
    share=st.floats(0.01, 0.99),
    first=st.sampled_from([1.0, -1.0]),
)
def test_a_stem_of_slips_is_that_of_equation_4(
    seed: int, band: float, ratio: float, share: float, first: float
) -> None:
    op, jump = _op(seed), band * ratio
    lead = share * (band + jump)
    start = op.u[0] - first * (0.5 * (band + jump) - lead)
    expected = ValveModel(band, jump).simulate(op.u, start)
    np.testing.assert_allclose(stem_of(op, band, jump, lead, first), expected, atol=1e-9)


def test_no_valve_stands_further_from_op_than_its_static_friction() -> None:
    op = _op(1)
    assert slips(op, 0.3, 0.1, 0.41, 1.0)[0].size == 0
    assert slips(op, 0.3, 0.1, -0.01, 1.0)[0].size == 0


@given(seed=st.integers(0, 50), share=st.floats(0.05, 0.95), first=st.sampled_from([1.0, -1.0]))
def test_a_lead_told_by_the_slip_that_comes_first_makes_the_same_stem(
    seed: int, share: float, first: float
) -> None:
    op = _op(seed)
    candidate = Candidate(0.0, 0.4, 0.1, share * 0.5, first, COARSE[0], 1)
    anchored = candidate.anchored(op)
    np.testing.assert_allclose(anchored.stem(op), candidate.stem(op), atol=1e-12)
    at, step = slips(op, anchored.band, anchored.jump, anchored.lead, anchored.first)
    assert at.size == 0 or step[0] * anchored.first > 0.0


@given(seed=st.integers(0, 30), band=st.floats(0.2, 0.6), ratio=st.floats(0.1, 1.0))
def test_every_set_of_slips_is_listed(seed: int, band: float, ratio: float) -> None:
    op, jump = _op(seed, 80), band * ratio
    starts = np.array([[0.1, 1.0]])
    y = np.random.default_rng(seed).normal(size=80)
    tables = ArxRegression(y, np.ones(80, dtype=np.bool_), ArxOrders(1, 2, 1)).tables
    regions, nodes, of, cost = slip_patterns(
        op,
        tables,
        np.array([[0.2, 0.6, 0.02, 0.6]]),
        starts,
        np.zeros(2),
        1.0,
        100_000,
        exact=True,
    )
    np.testing.assert_allclose(cost, one_step_costs(op, tables, nodes, 1.0)[0])
    at, step = slips(op, band, jump, 0.1, 1.0)
    if at.size == 0 or step[0] < 0.0:
        return  # the first slip is not the one that is asked for
    s_low, s_high, j_low, j_high = regions.T
    inside = (s_low <= band) & (band <= s_high) & (j_low <= jump) & (jump <= j_high)
    assert inside.any()
    region = regions[np.flatnonzero(inside)[0]]
    same, _ = slips(op, region[1], min(region[3], region[1]), 0.1, 1.0)
    np.testing.assert_array_equal(same, at)
    assert (of == 0).all()
