"""Recorded loops of plants: verdicts of the people who published them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from estimator import Identification, Verdict, identify


def _read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return (
        np.array([float(row["op"]) for row in rows]),
        np.array([float(row["pv"]) for row in rows]),
    )


@pytest.fixture(scope="module")
def plant(shared_data: Path) -> list[tuple[dict[str, str], Identification]]:
    with (shared_data / "plant_labels.csv").open(newline="") as file:
        labels = list(csv.DictReader(file))
    folder = shared_data / "plant"
    return [(label, identify(*_read(folder / label["file"]), period=10.0)) for label in labels]


def _auc(scores: list[float], sticky: list[bool]) -> float:
    truth = np.array(sticky)
    value = np.array(scores)
    ahead = value[truth][:, None] - value[~truth]
    return float((ahead > 0).mean() + 0.5 * (ahead == 0).mean())


def test_chem10_has_the_stick_band_of_the_literature(shared_data: Path) -> None:
    # 1.70 (grid search), 1.79 (Lee et al.), 1.85 (Karra and Karim): Table 1 of the paper
    result = identify(*_read(shared_data / "isdb" / "CHEM10.csv"))
    assert result.verdict is Verdict.STICTION
    assert 1.5 <= result.stick_band.value <= 2.0


@pytest.mark.parametrize("name", ["CHEM1", "CHEM2", "CHEM10", "CHEM13", "PAP2", "PAP4", "PAP9"])
def test_verdicts_of_the_isdb(shared_data: Path, name: str) -> None:
    with (shared_data / "isdb_labels.csv").open(newline="") as file:
        labels = {row["file"]: row["label"] for row in csv.DictReader(file)}
    result = identify(*_read(shared_data / "isdb" / f"{name}.csv"))
    assert result.verdict.value == labels[f"{name}.csv"]


@pytest.mark.slow
def test_score_separates_the_plant_s_windows(plant) -> None:
    judged = [(label, r) for label, r in plant if r.verdict is not Verdict.NOT_ASSESSABLE]
    sticky = [label["label"] == "stiction" for label, _ in judged]
    ours = _auc([r.score for _, r in judged], sticky)
    published = _auc([float(label["published_index"]) for label, _ in judged], sticky)
    assert ours >= 0.98
    assert ours > published


@pytest.mark.slow
def test_few_windows_of_the_plant_cannot_be_judged(plant) -> None:
    refused = [r for _, r in plant if r.verdict is Verdict.NOT_ASSESSABLE]
    assert len(refused) <= 0.15 * len(plant)
    assert all(r.reasons for r in refused)


@pytest.mark.slow
def test_no_healthy_window_of_the_plant_is_accused(plant) -> None:
    accused = [
        label["file"]
        for label, r in plant
        if label["label"] == "no_stiction" and r.verdict is Verdict.STICTION
    ]
    assert accused == []
