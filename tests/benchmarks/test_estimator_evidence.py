"""Criteria are read from the benchmarks' figures; a missing figure is said to be missing."""

from __future__ import annotations

import json

import pytest

from benchmarks.estimator_evidence import Criterion, criteria_of, main
from benchmarks.report import keep


def test_a_figure_is_met_within_its_limits_and_unknown_when_missing():
    assert Criterion("x", 97.0, 80.0, 97.0, "a").met is True
    assert Criterion("x", 97.1, 80.0, 97.0, "a").met is False
    assert Criterion("x", float("nan"), 80.0, 97.0, "a").met is None
    assert Criterion("x", 1.0, float("-inf"), 5.0, "a").limit == "at most 5"


def _summary(example, method, **changes):
    row = {"example": example, "method": method, "stick_band": 0.5, "slip_jump": 20.0, "gain": 4.0}
    row |= {"cover_stick_band": 0.9, "cover_slip_jump": 0.75, "no_worse": 1.0}
    return row | changes


def test_criteria_come_from_the_files(tmp_path):
    search = _summary("Example 1", "search, auto")
    keep(tmp_path, "paper_repeated", "", {"summary": [search]})
    rivals = [
        _summary("Example 1", "grid 0.1", no_worse=0.95),
        _summary("Example 2", "nlp, paper, M=7 twice", no_worse=1.0),
        _summary("Example 1", "the paper (6.98/4.01, its machine)", no_worse=float("nan")),
    ]
    keep(tmp_path, "paper", "", {"summary": rivals})
    keep(
        tmp_path,
        "robustness",
        "",
        {"summary": {"false alarms on healthy valves": {"hits": 1, "count": 50}}},
    )
    found = {c.name: c for c in criteria_of(tmp_path)}
    assert found["Example 1: median error of S, %"].met is True
    assert found["Example 1: J in its 90 % interval, % of windows"].value == pytest.approx(75.0)
    assert found["Example 1: J in its 90 % interval, % of windows"].met is False
    assert found["Example 2: median error of S, %"].met is None
    costs = found["windows whose cost is no worse than grid's and nlp's, %, least of both"]
    assert costs.value == pytest.approx(95.0)
    assert found["false alarms, %"].value == pytest.approx(2.0)
    assert found["misses, %"].met is None
    assert found["ISDB verdicts right, %"].met is None


def test_the_table_says_what_is_not_measured(tmp_path, capsys):
    assert main(["--out", str(tmp_path), "--read"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("not measured") == len(criteria_of(tmp_path))
    kept = json.loads((tmp_path / "estimator_evidence.json").read_text())["criteria"]
    assert {one["met"] for one in kept} == {None}
