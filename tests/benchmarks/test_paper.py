"""The benchmark's arithmetic on made-up estimates, its currency, and one short run."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from benchmarks import paper
from benchmarks.examples import EXAMPLES, example_window
from benchmarks.paper import main
from benchmarks.paper_methods import Estimate, estimates, free_start_cost
from benchmarks.paper_summary import held, published, summarise
from estimator.published.paper_fit import ArxStructure, ArxWindow
from loop_model import LoopModel, ProcessModel, ValveModel

TRUTH = LoopModel(ValveModel(10.0, 2.0), ProcessModel((-0.5,), (0.5,), 1, 0.0, 1.0))


def _estimate(method, stick_band, slip_jump, cost, seconds, band=None):
    return Estimate(
        method=method,
        stick_band=stick_band,
        slip_jump=slip_jump,
        gain=1.1,
        poles=(0.55 + 0.0j, 0.2 + 0.0j),
        cost=cost,
        seconds=seconds,
        stem0=0.0,
        stick_band_interval=band,
    )


def test_summary_of_two_windows():
    windows = [
        [_estimate("search", 10.0, 2.0, 1.0, 0.1, (9.0, 11.0)), _estimate("grid", 11, 3, 2.0, 5.0)],
        [_estimate("search", 10.2, 2.0, 1.0, 0.1, (10.1, 11)), _estimate("grid", 11, 3, 0.8, 5.0)],
    ]
    search, grid = summarise("made up", TRUTH, windows)
    assert search.stick_band == pytest.approx(1.0)
    assert search.cover_stick_band == 0.5
    assert search.slowest_pole == pytest.approx(10.0)
    assert search.poles == pytest.approx(0.05)
    assert grid.stick_band == pytest.approx(10.0)
    assert grid.slip_jump == pytest.approx(50.0)
    assert grid.static_friction == pytest.approx(100.0 / 6.0)
    assert grid.gain == pytest.approx(10.0)
    assert grid.no_worse == 0.5
    assert grid.worst_cost == pytest.approx(1.25)
    assert grid.time_ratio == pytest.approx(50.0)


def test_the_search_is_held_to_its_limits():
    one = [_estimate("search, auto", 10.2, 2.0, 1.0, 0.1, (9.0, 11)), _estimate("g", 11, 3, 2, 5)]
    windows = [one] * 60
    rows = {
        name: (value, limit, met)
        for _, name, value, limit, met in held(summarise("made up", TRUTH, windows))
    }
    assert rows["median error of S, % (auto)"] == (pytest.approx(2.0), "at most 1", "**no**")
    assert rows["median error of J, % (auto)"][2] == "yes"
    assert rows["S in its 90 % interval, % of windows (auto)"] == (100.0, "80 to 97", "**no**")
    assert rows["J in its 90 % interval, % of windows (auto)"][2] == "not measured"
    few = held(summarise("made up", TRUTH, windows[:59]))
    assert {met for _, name, _, _, met in few if "interval" in name} == {"too few windows"}


def test_a_window_without_a_verdict_counts_against_the_search():
    windows = [[_estimate("search", math.nan, math.nan, math.nan, 0.1), _estimate("g", 1, 1, 1, 1)]]
    search, grid = summarise("made up", TRUTH, windows)
    assert math.isnan(search.stick_band)
    assert grid.no_worse == 0.0
    assert grid.worst_cost == math.inf


def test_the_papers_row_holds_its_own_errors():
    row = published(EXAMPLES[0])
    # 6.98 for 7, 4.01 for 4; gain 0.8915 for 1.
    assert row.static_friction == pytest.approx(100 * 0.02 / 7)
    assert row.dynamic_friction == pytest.approx(100 * 0.01 / 4)
    assert row.gain == pytest.approx(10.85, abs=0.05)
    assert row.seconds == 4.0
    assert math.isnan(row.no_worse)


def test_the_first_position_is_free_for_every_valve():
    window = example_window(EXAMPLES[0], 0, samples=300)
    currency = ArxWindow.of(window.op, window.pv, ArxStructure(3, 3))
    truth = EXAMPLES[0].valve
    started_true = currency.solve(window.stem)[1]
    started_wrong = currency.solve(truth.simulate(window.op, float(window.op[0])))[1]
    free = free_start_cost(currency, truth.stick_band, truth.slip_jump)
    # The window begins in mid-cycle: u_0 is a wrong position, one of the others moves as the truth.
    assert started_wrong > 1.5 * started_true
    assert free == pytest.approx(started_true, rel=0.02)
    assert free_start_cost(currency, 11.0, 3.0, [float(window.stem[0])]) <= started_true + 1e-12
    assert np.isfinite(free)


@pytest.mark.thorough
def test_the_search_does_not_end_above_the_true_valve():
    """Windows whose likelihood has a second peak: the way to the right one is narrow."""
    example = EXAMPLES[1]
    ratios, errors = [], []
    for seed in (3, 4, 16, 64, 71, *range(100, 115)):
        told, search = estimates(
            example, example_window(example, seed), methods=("truth",), criteria=("auto",)
        )[::-1]
        assert told.method == "the true valve"
        ratios.append(search.cost / told.cost)
        errors.append(abs(search.stick_band / example.valve.stick_band - 1.0))
    assert np.median(ratios) <= 1.001
    assert np.sort(errors)[17] <= 0.03  # 18 of 20 windows


@pytest.mark.thorough
def test_one_short_run_writes_table_and_figures(tmp_path, capsys, monkeypatch):
    pytest.importorskip("casadi", reason="CasADi is an optional dependency")
    monkeypatch.setattr(paper, "EXAMPLES", EXAMPLES[:1])
    options = ["--runs", "1", "--samples", "250", "--grid-step", "4", "--criteria", "auto"]
    options += ["--starts", "1", "--name", "short"]
    assert main([*options, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert (tmp_path / "short.md").read_text() == printed
    figures = json.loads((tmp_path / "short.json").read_text())
    methods = {row["method"] for row in figures["summary"] if row["example"] == "Example 1"}
    assert {"search, auto", "nlp, paper, M=1 twice", "grid 4"} <= methods
