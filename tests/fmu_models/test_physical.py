"""The physical valve leaves its grid of 0.1 ms where nothing happens; the stem moves alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmu_models import open_plant
from fmu_models.packing import build_source
from fmu_models.tables import SOURCES

STICK_BAND = 8.0


@pytest.fixture(scope="module")
def every_step(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same model that takes every step of its grid."""
    folder = tmp_path_factory.mktemp("physical")
    text = (SOURCES / "physical.c").read_text()
    skips = "const int skips = (int)p->v.valve != VALVE_LUGRE;"
    assert skips in text
    copy = folder / "physical.c"
    copy.write_text(text.replace(skips, "const int skips = 0;"))
    return build_source(copy, output=folder)[1]


def moves(kind: str) -> np.ndarray:
    generator, k = np.random.default_rng(1), np.arange(300)
    if kind == "walk":
        return np.clip(50.0 + np.cumsum(generator.normal(0.0, 2.0, k.size)), -5.0, 105.0)
    if kind == "steps":
        return np.repeat(generator.uniform(-10.0, 110.0, 30), 10)
    return 50.0 + 12.0 * np.sin(k / 40.0)


@pytest.mark.parametrize("valve", [0, 4])
@pytest.mark.parametrize("kind", ["walk", "steps", "wave"])
def test_the_stem_is_within_a_hundredth_of_the_stick_band(
    every_step: Path, valve: int, kind: str
) -> None:
    op = moves(kind)
    parameters = {"valve": valve, "noise_std": 0.0, "op": float(op[0]), "stick_band": STICK_BAND}
    stems = []
    for model in (every_step, "physical"):
        with open_plant(model, parameters=parameters, isolated=False) as plant:
            stems.append(plant.run(op.size, {"op": op})["stem"])
    np.testing.assert_allclose(stems[1], stems[0], atol=0.01 * STICK_BAND)
    assert np.ptp(stems[0]) > 10.0


def test_the_closed_loop_oscillates_alike(every_step: Path) -> None:
    """A cycle with friction is chaotic: single samples part, spread and travel do not."""
    parameters = {"controller": 1, "op_start": 40.0}
    spread, travel = [], []
    for model in (every_step, "physical"):
        with open_plant(model, parameters=parameters, isolated=False) as plant:
            table = plant.run(2000, {})
        spread.append(table["pv"].std())
        travel.append(np.abs(np.diff(table["stem"])).sum())
    assert spread[1] == pytest.approx(spread[0], rel=0.1)
    assert travel[1] == pytest.approx(travel[0], rel=0.1)
