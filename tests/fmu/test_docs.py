"""docs/fmu.md against the program: its map is a map, its table the catalogue."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from fieldlink.lab.fmu import FmuMap
from fmu_models import catalogue

TEXT = (Path(__file__).parents[2] / "docs" / "fmu.md").read_text(encoding="utf-8")


def test_the_map_is_a_map() -> None:
    block = re.search(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    assert block is not None
    mapping = FmuMap.model_validate(tomllib.loads(block[1]))
    assert mapping.controller is not None
    assert (mapping.controller.at(599.0), mapping.controller.at(600.0)) == (500.0, 650.0)
    assert mapping.inputs["OP"].variable == "valve.opening"


def test_the_table_is_the_catalogue() -> None:
    rows = dict(re.findall(r"^\| `(\w+)` \| .*\| ([\d.]+) s \|", TEXT, re.MULTILINE))
    assert {name: float(period) for name, period in rows.items()} == {
        name: model.period for name, model in catalogue.items()
    }
