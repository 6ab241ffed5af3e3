"""Criteria are read from the benchmarks' figures; a missing figure is reported as missing."""

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


def _counts(**changes):
    counts = {"healthy": 50, "accused": 0, "healthy_uncertain": 0}
    counts |= {"sticky": 50, "missed": 0, "sticky_uncertain": 0}
    counts |= {"band_error": 0.004, "band_coverage": 0.9, "jump_coverage": 0.85}
    return counts | changes


def test_the_papers_examples_are_held_to_their_limits(tmp_path):
    constant = "Example 1, constant set-point"
    rows = [
        _summary("Example 1", "search, auto"),
        _summary(constant, "search, auto", gain=12.0),
        _summary(constant, "oracle: the true moves", gain=10.0),
    ]
    keep(tmp_path, "paper_repeated", "", {"summary": rows})
    rivals = [
        _summary("Example 1", "grid 0.1", no_worse=0.95),
        _summary("Example 2", "nlp, paper, M=7 twice", no_worse=1.0),
        _summary("Example 1", "the paper (6.98/4.01, its machine)", no_worse=float("nan")),
    ]
    keep(tmp_path, "paper", "", {"summary": rivals})
    found = {c.name: c for c in criteria_of(tmp_path)}
    assert found["Example 1: median error of S, %"].met is True
    assert found["Example 1: J in its 90 % interval, % of windows"].value == pytest.approx(75.0)
    assert found["Example 1: J in its 90 % interval, % of windows"].met is False
    assert found["Example 2: median error of S, %"].met is None
    # the oracle's own error plus a quarter
    assert found[f"{constant}: median error of the gain, %"].high == pytest.approx(12.5)
    assert found[f"{constant}: median error of the gain, %"].met is True
    costs = found["windows whose cost is no worse than grid's and nlp's, %, least of both"]
    assert costs.value == pytest.approx(95.0)


def test_the_report_family_is_judged_overall_and_in_its_worst_kind(tmp_path):
    kinds = {
        "pi": _counts(jump_coverage=0.99),
        "sine": _counts(accused=3, healthy_uncertain=2, missed=1),
        "tight": _counts(sticky=0, band_coverage=None, jump_coverage=None, band_error=None),
    }
    total = _counts(healthy=150, accused=3, healthy_uncertain=2, sticky=100, missed=1)
    laws = {"he": _counts(), "kano": _counts(band_error=0.06), "none": _counts(band_error=None)}
    keep(tmp_path, "report_family", "", {"total": total, "kinds": kinds, "laws": laws})
    found = {c.name: c for c in criteria_of(tmp_path)}
    # an uncertain verdict is half an error: (3 + 2 / 2) of 150, and of 50
    assert found["healthy valves accused, %"].value == pytest.approx(100 * 4 / 150)
    assert found["healthy accused, worst kind, %"].value == pytest.approx(8.0)
    assert found["healthy accused, worst kind, %"].met is False
    assert found["sticky missed, worst kind, %"].value == pytest.approx(2.0)
    assert found["S, median error, He's valve, %"].met is True
    assert found["S, median error, worst other law, %"].met is False
    assert found["J in its 90 % interval, lowest kind, %"].met is True
    assert found["J in its 90 % interval, highest kind, %"].met is False


def test_times_are_held_to_the_limit_of_their_kind(tmp_path):
    kinds = [
        {"name": "pi, sticky", "mean_ms": 50.0, "limit_ms": 60.0},
        {"name": "pi, healthy", "mean_ms": 30.0, "limit_ms": 25.0},
    ]
    rivals = [{"method": "grid 0.1", "over_ours": 400.0}, {"method": "grid 0.1", "over_ours": 90.0}]
    keep(tmp_path, "estimator_speed", "", {"kinds": kinds, "rivals": rivals})
    found = {c.name: c for c in criteria_of(tmp_path)}
    assert found["core ms a window, slowest kind"].met is True
    assert found["core ms a healthy window, slowest kind"].met is False
    assert found["time of the grid over ours, least"].value == 90.0
    assert found["time of the optimisation over ours, least"].met is None


def test_the_table_says_what_is_not_measured(tmp_path, capsys):
    assert main(["--out", str(tmp_path), "--read"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("not measured") == len(criteria_of(tmp_path))
    kept = json.loads((tmp_path / "estimator_evidence.json").read_text())["criteria"]
    assert {one["met"] for one in kept} == {None}
