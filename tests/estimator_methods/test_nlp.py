"""The paper's optimisation: what it is, where it starts, and that a polish never harms."""

from __future__ import annotations

import builtins
import math

import numpy as np
import pytest

from estimator.outcomes import EstimatorError
from estimator.published.nlp import nlp_paper, nlp_polish
from estimator.published.nlp_problem import Programme
from estimator.published.nlp_starts import starting_frictions
from estimator.published.paper_fit import ArxStructure, ArxWindow
from estimator.valves import HeValve, SmoothedValve

pytest.importorskip("casadi", reason="CasADi is an optional dependency")


@pytest.fixture(scope="module")
def clean(sticky_loop):
    stem = sticky_loop.valve.simulate(sticky_loop.op, float(sticky_loop.op[0]))
    return sticky_loop.op, sticky_loop.process.simulate(stem)


def test_starts_lie_in_the_triangle_and_include_the_ellipse():
    pairs = starting_frictions(12.0, 8.0, count=7)
    assert len(pairs) == 7
    assert all(0.0 <= dynamic <= static and static + dynamic < 12.0 for static, dynamic in pairs)
    assert sum(math.isclose(static + dynamic, 8.0) for static, dynamic in pairs) >= 3


def test_starts_without_an_ellipse_cover_both_edges():
    pairs = starting_frictions(10.0, math.nan, count=7)
    assert len(pairs) == 7
    assert any(dynamic == 0.0 for _, dynamic in pairs)
    assert any(static == dynamic for static, dynamic in pairs)


def test_more_starts_than_points_give_every_point_once():
    pairs = starting_frictions(2.0, math.nan, count=500, step=0.5)
    assert len(pairs) == len(set(pairs)) < 20


def test_a_start_in_the_basin_of_the_truth_ends_at_the_truth(clean, sticky_loop):
    op, pv = clean
    structure = ArxStructure(2, 2, intercept=False)
    window = ArxWindow.of(op, pv, structure)
    near = HeValve(4.505, 1.48)
    theta = window.solve(near.simulate(op))[0]
    programme = Programme(100.0 * op, 100.0 * pv, structure, warm=True)
    end = programme.solve(
        100.0 * near.static_friction,
        100.0 * near.dynamic_friction,
        100.0 * float(op[0]),
        theta,
        tau=100.0,
        free_stem0=False,
        reach=3.0,
    )
    assert end.dynamic_friction == pytest.approx(150.0, abs=0.01)
    np.testing.assert_allclose(end.theta[:2], sticky_loop.process.a, atol=1e-4)


def test_paper_mode_reports_every_start_and_keeps_the_best(sticky_loop):
    fit = nlp_paper(sticky_loop.op, sticky_loop.pv, na=2, nb=2, starts=4, max_iterations=40)
    assert len(fit.attempts) == 8
    allowed = [a.cost for a in fit.attempts if a.variance_ratio >= 0.1 * (1 - 1e-6)]
    assert fit.best.cost == min(allowed)
    assert isinstance(fit.best.valve, SmoothedValve)
    assert 0.0 <= fit.best.dynamic_friction <= fit.best.static_friction


def test_paper_mode_is_repeatable(sticky_loop):
    options = {"na": 2, "nb": 2, "starts": 2, "initial": ("first",), "max_iterations": 20}
    once = nlp_paper(sticky_loop.op, sticky_loop.pv, **options)
    again = nlp_paper(sticky_loop.op, sticky_loop.pv, **options)
    assert once.attempts == again.attempts


@pytest.mark.parametrize(
    "start", [(4.5, 1.5), (4.4, 1.2), (2.0, 0.0), (4.0, 4.0), (0.0, 0.0), (50.0, 40.0)]
)
def test_polish_is_never_worse_than_its_start(sticky_loop, start):
    window = ArxWindow.of(sticky_loop.op, sticky_loop.pv, ArxStructure(2, 2))
    begun = window.fit(HeValve(*start), float(sticky_loop.op[0])).cost
    polished = nlp_polish(sticky_loop.op, sticky_loop.pv, *start, na=2, nb=2, max_iterations=40)
    assert polished.best.cost <= begun
    again = window.fit(polished.best.valve, polished.best.stem0)
    assert again.cost == pytest.approx(polished.best.cost, rel=1e-9)


def test_polish_finds_the_truth_from_beside_it(clean):
    op, pv = clean
    polished = nlp_polish(op, pv, 4.5, 1.45, na=2, nb=2, stages=3)
    assert polished.best.cost == pytest.approx(0.0, abs=1e-9)
    assert polished.best.dynamic_friction == pytest.approx(1.5, abs=1e-4)


def test_without_casadi_the_message_says_what_to_install(sticky_loop, monkeypatch):
    real = builtins.__import__

    def absent(name, *args, **kwargs):
        if name == "casadi":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", absent)
    for call in (
        lambda: nlp_paper(sticky_loop.op, sticky_loop.pv, na=2, nb=2),
        lambda: nlp_polish(sticky_loop.op, sticky_loop.pv, 4.0, 1.0, na=2, nb=2),
    ):
        with pytest.raises(EstimatorError, match=r"fieldlink\[nlp\]"):
            call()


def test_no_initial_position_is_refused(sticky_loop):
    with pytest.raises(EstimatorError, match="initial"):
        nlp_paper(sticky_loop.op, sticky_loop.pv, na=2, nb=2, initial=())


def test_bad_starts_are_refused():
    with pytest.raises(EstimatorError, match="count"):
        starting_frictions(10.0, 1.0, count=0)
