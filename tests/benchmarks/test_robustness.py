"""The arithmetic of the robustness tables, on made-up judgements, and one small run."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from benchmarks.judgement import Judgement, Share, coverage
from benchmarks.robustness import main
from benchmarks.robustness_table import STICKY_HEADER, sticky_row, tables
from tests.benchmarks.made_up import BASE

HEALTHY = replace(BASE, stick_band=0.0, slip_jump=0.0, physics="healthy")


def _judged(loop, verdict, value=float("nan"), low=0.0, high=0.0, turns=9):
    return Judgement(
        loop=loop,
        verdict=verdict,
        reasons=("made_up",),
        score=1.0,
        stick_band=(value, low, high),
        slip_jump=(1.2, 0.5, 2.0),
        fit=(0.9, 0.8),
        turns=turns,
        seconds=0.1,
    )


JUDGED = [
    _judged(BASE, "stiction", 4.4, 4.1, 5.0),
    _judged(BASE, "stiction", 3.8, 3.7, 4.1),
    _judged(BASE, "no_stiction", 0.1, 0.0, 0.2),
    _judged(BASE, "not_assessable"),
]


def test_a_row_counts_verdicts_and_measures_what_was_found():
    row = dict(zip(STICKY_HEADER, sticky_row("made up", JUDGED), strict=True))
    assert row["n"] == 4
    assert row["missed %"] == 25.0
    assert row["not assessable %"] == 25.0
    assert row["bias S %"] == pytest.approx(2.5)
    assert row["|error| S %"] == pytest.approx(7.5)
    assert row["|error| J, % of S"] == pytest.approx(5.0)
    assert row["cover S %"] == 50.0
    assert row["cover J %"] == 100.0


def test_choudhurys_band_counts_for_verdicts_and_in_its_own_row_only():
    found = _judged(replace(BASE, physics="Choudhury"), "stiction", 12.0, 11.0, 13.0)
    mixed = dict(zip(STICKY_HEADER, sticky_row("mixed", [*JUDGED, found]), strict=True))
    assert mixed["n"] == 5
    assert mixed["bias S %"] == pytest.approx(2.5)
    own = sticky_row("valve: Choudhury", [found], any_physics=True)
    assert own[4] == pytest.approx(200.0)


def test_summary_counts_false_alarms_misses_and_names_them():
    unseen = _judged(BASE, "no_stiction", turns=1)
    alarm = _judged(replace(HEALTHY, seed=8), "stiction", 1.0, 0.9, 1.1)
    text, figures = tables([*JUDGED, unseen, alarm, _judged(HEALTHY, "no_stiction")], samples=1000)
    summary = figures["summary"]
    assert summary["false alarms on healthy valves"] == {"hits": 1, "count": 2}
    assert summary["misses, S >= 2 % of OP, moderate noise"] == {"hits": 1, "count": 4}
    assert "--loop h8" in text
    assert "| s1 " in text


def test_share_gives_the_exact_interval():
    # Clopper and Pearson: no event in 10 leaves 1 - 0.05**(1/10) open.
    assert Share(0, 10).interval == pytest.approx((0.0, 1.0 - 0.05**0.1))
    assert Share(10, 10).interval == pytest.approx((0.05**0.1, 1.0))
    assert coverage(JUDGED[:2], "stick_band") == Share(1, 2)


def test_a_small_run_writes_tables_and_figures(tmp_path, capsys):
    options = ["--runs", "1", "--seed", "3", "--samples", "300", "--jobs", "1"]
    every = tmp_path / "loops.jsonl"
    assert main([*options, "--out", str(tmp_path), "--loops", str(every)]) == 0
    assert (tmp_path / "robustness.md").read_text() == capsys.readouterr().out
    figures = json.loads((tmp_path / "robustness.json").read_text())
    loops = [json.loads(line) for line in every.read_text().splitlines()]
    assert [loop["name"] for loop in loops] == ["s3", "h3"]
    assert figures["summary"]["false alarms on healthy valves"]["count"] == 1
    assert main(["--loop", "s3", "--samples", "300", "--csv", str(tmp_path / "s3.csv")]) == 0
    shown = json.loads(capsys.readouterr().out.rsplit("}", 1)[0] + "}")
    assert shown["verdict"] == loops[0]["verdict"]
    assert (tmp_path / "s3.csv").read_text().startswith("op,pv,sp,stem\n")
