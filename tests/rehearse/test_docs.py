"""docs/rehearse.md must show every key, scenario and defect as it is."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, get_args, get_origin

import pytest
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from fieldlink.lab.rehearse import Defect, load_scenario, shipped_scenarios
from fieldlink.lab.rehearse import models as m
from fieldlink.lab.rehearse.expected import END, Expectation

PAGE = (Path(__file__).parents[2] / "docs" / "rehearse.md").read_text(encoding="utf-8")

TABLES: list[type[BaseModel]] = [
    m.Scenario,
    m.Summary,
    m.RehearsedPlant,
    m.PlantVariables,
    m.ControllerSettings,
    m.ValveWear,
    m.Load,
    m.Sinusoid,
    m.SensorFault,
    m.NetworkFault,
    m.Repair,
    m.Manual,
    m.Disable,
    m.Misestimate,
    m.DaemonSettings,
]


def default_of(model: type[BaseModel], key: str) -> str:
    value = model.model_fields[key].default
    if value is PydanticUndefined:
        return "needed"
    if value is None or isinstance(value, BaseModel):
        return ""
    return "the end" if value == END else f"`{json.dumps(value)}`"


def meaning_of(field: FieldInfo) -> str:
    meaning = " ".join(str(field.description).split())
    if get_origin(field.annotation) is not Literal:
        return meaning
    choices = ", ".join(f"`{choice}`" for choice in get_args(field.annotation))
    return f"{meaning.rstrip('.')}: {choices}."


def rows_of(model: type[BaseModel]) -> str:
    fields = {key: field for key, field in model.model_fields.items() if key != "kind"}
    if model in (m.ControllerSettings, m.SensorFault, m.NetworkFault):
        fields = dict(model.model_fields)
    rows = [
        f"| `{key}` | {default_of(model, key)} | {meaning_of(field)} |\n"
        for key, field in sorted(fields.items(), key=lambda item: item[0] != "kind")
    ]
    return "| key | default | meaning |\n| --- | --- | --- |\n" + "".join(rows)


def expected_tables() -> Iterator[str]:
    """Give each table of a scenario file: its heading, its sentence, its keys."""
    for model in TABLES:
        assert model.__doc__ is not None
        heading, sentence = model.__doc__.strip().split(": ", 1)
        heading = heading.replace("``", "`")
        sentence = sentence[0].upper() + sentence[1:]
        yield f"**{heading}** {sentence}\n\n{rows_of(model)}"


def expected_expectations() -> Iterator[str]:
    for model in get_args(get_args(Expectation)[0]):
        found = re.fullmatch(r'kind = "(\w+)": (.*)', model.__doc__.strip(), re.DOTALL)
        assert found is not None
        sentence = found[2][0].upper() + found[2][1:]
        yield f"**`{found[1]}`** {sentence}\n\n{rows_of(model)}"


def expected_scenarios() -> str:
    rows = []
    for path in shipped_scenarios():
        summary = load_scenario(path).scenario.scenario
        defects = ", ".join(f"`{defect}`" for defect in summary.defects)
        rows.append(f"| `{path.stem}` | {summary.title} | {defects} |\n")
    return "| scenario | what happens | turned red by |\n| --- | --- | --- |\n" + "".join(rows)


def expected_defects() -> str:
    rows = "".join(f"| `{defect}` | {defect.text} |\n" for defect in Defect)
    return f"| defect | what it does |\n| --- | --- |\n{rows}"


@pytest.mark.parametrize("text", [*expected_tables(), *expected_expectations()])
def test_every_key_is_documented_as_it_is(text: str) -> None:
    assert text in PAGE


def test_every_scenario_and_defect_is_listed() -> None:
    assert expected_scenarios() in PAGE
    assert expected_defects() in PAGE


def test_the_example_is_a_scenario(tmp_path: Path) -> None:
    (example,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "example.toml").write_text(example)
    assert len(load_scenario(tmp_path / "example.toml").scenario.expect) == 2
