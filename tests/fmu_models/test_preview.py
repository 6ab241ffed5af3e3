"""What a plant is by its archive alone is what it is once it is open."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmu_models import PlantError, StartValue, open_plant, preview_plant
from fmu_models.example_system import build_example_system


@pytest.mark.parametrize("name", ["example1", "fourtank", "physical"])
def test_a_plant_of_the_catalogue(name: str) -> None:
    with open_plant(name, period=1.0, isolated=False) as plant:
        assert preview_plant(name, period=1.0) == plant.info


def test_a_system(tmp_path: Path) -> None:
    file = build_example_system(tmp_path)
    with open_plant(file, period=1.0, isolated=False) as plant:
        assert preview_plant(file, period=1.0) == plant.info


@pytest.mark.parametrize("kind", ["fmi1-cs", "fmi1-me", "fmi2"])
def test_other_versions(mini_fmus: dict[str, Path], kind: str) -> None:
    with open_plant(mini_fmus[kind], period=0.5, isolated=False) as plant:
        assert preview_plant(mini_fmus[kind], period=0.5) == plant.info


@pytest.mark.parametrize(
    "parameters",
    [{"nothing": 1.0}, {"stick_band": float("nan")}, {"stick_band": "wide"}, {"seed": 0.5}],
)
def test_start_values_are_refused_alike(parameters: dict[str, StartValue]) -> None:
    said = []
    for attempt in (open_plant, preview_plant):
        with pytest.raises(PlantError) as refused:
            attempt("example1", period=1.0, parameters=parameters)
        said.append((type(refused.value), str(refused.value)))
    assert said[0] == said[1]
