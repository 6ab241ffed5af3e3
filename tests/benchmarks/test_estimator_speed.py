"""The speed benchmark runs end to end and keeps what it prints."""

from __future__ import annotations

import json

import pytest

from benchmarks import estimator_speed
from benchmarks.estimator_speed import FAMILY_KINDS, least_seconds, main


def test_the_least_of_several_runs_counts() -> None:
    runs = []
    assert least_seconds(lambda: runs.append(sum(range(1000))), 3) >= 0.0
    assert len(runs) == 3


@pytest.mark.thorough
def test_every_kind_is_timed_and_every_rival_compared(tmp_path, capsys, monkeypatch) -> None:
    chosen = FAMILY_KINDS[:1]
    monkeypatch.setattr(estimator_speed, "FAMILY_KINDS", chosen)
    options = ["--samples", "400", "--windows", "1", "--repeats", "1", "--rival-windows", "1"]
    options += ["--grid-step", "3", "--starts", "0"]
    assert main([*options, "--out", str(tmp_path)]) == 0
    assert (tmp_path / "estimator_speed.md").read_text() == capsys.readouterr().out
    figures = json.loads((tmp_path / "estimator_speed.json").read_text())
    kinds = {kind["name"]: kind for kind in figures["kinds"]}
    assert {f"{kind}, healthy" for kind in chosen} <= set(kinds)
    assert "Example 2, constant set-point" in kinds
    assert all(kind["mean_ms"] > 0.0 for kind in kinds.values())
    assert [rival["method"] for rival in figures["rivals"]] == ["grid 3", "grid 3"]
    assert all(rival["over_ours"] > 0.0 for rival in figures["rivals"])
