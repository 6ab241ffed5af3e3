"""The benchmark's arithmetic: errors, coverage and ratios of made-up estimates."""

from __future__ import annotations

import json

import pytest

from benchmarks.paper import Estimate, main, summarise
from loop_model import LoopModel, ProcessModel, ValveModel

TRUTH = LoopModel(ValveModel(10.0, 2.0), ProcessModel((-0.5,), (0.5,), 1, 0.0, 1.0))


def _estimate(method, stick_band, slip_jump, cost, seconds, band=None):
    return Estimate(
        method=method,
        stick_band=stick_band,
        slip_jump=slip_jump,
        gain=1.1,
        slowest_pole=0.5,
        cost=cost,
        seconds=seconds,
        stem0=0.0,
        stick_band_interval=band,
    )


def test_summary_of_two_windows():
    windows = [
        [_estimate("search", 10.0, 2.0, 1.0, 0.1, (9.0, 11.0)), _estimate("grid", 11, 3, 2.0, 5.0)],
        [_estimate("search", 10.2, 2.0, 1.0, 0.1, (10.1, 11)), _estimate("grid", 11, 3, 0.9, 5.0)],
    ]
    search, grid = summarise("made up", TRUTH, windows)
    assert search.stick_band == pytest.approx(0.01)
    assert search.coverage_stick_band == 0.5
    assert grid.stick_band == pytest.approx(0.1)
    assert grid.slip_jump == pytest.approx(0.5)
    assert grid.static_friction == pytest.approx(1.0 / 6.0)
    assert grid.gain == pytest.approx(0.1)
    assert grid.search_no_worse == 0.5
    assert grid.time_ratio == pytest.approx(50.0)


@pytest.mark.slow
def test_one_short_run_writes_table_and_figures(tmp_path, capsys):
    pytest.importorskip("casadi", reason="CasADi is an optional dependency")
    options = ["--runs", "1", "--samples", "250", "--grid-step", "2", "--criteria", "auto"]
    options += ["--starts", "1"]
    assert main([*options, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert (tmp_path / "paper.md").read_text() == printed
    figures = json.loads((tmp_path / "paper.json").read_text())
    methods = {row["method"] for row in figures["summary"] if row["example"] == "Example 1"}
    assert {"search, auto", "nlp, paper, M=1 twice", "grid 2, as published"} <= methods
