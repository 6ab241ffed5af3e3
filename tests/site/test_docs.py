"""docs/site-file.md must list every key with its default and its meaning."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from fieldlink.registers import DataType, Table
from fieldlink.site import (
    Device,
    EstimatorSettings,
    HistorianTable,
    Loop,
    PiSettings,
    PlantSettings,
    Quirks,
    Tls,
    WriteBack,
    WriteLimits,
)
from fieldlink.site.compensate import CompensateSettings
from fieldlink.site.models import (
    EstimationSettings,
    ExchangeAddresses,
    ExternalSettings,
    PlantVariables,
    ReportSettings,
    SiteSettings,
    WebSettings,
)
from fieldlink.site.mqtt import MqttSettings, MqttSpool, MqttTls
from fieldlink.site.node_map import NODE_COLUMNS
from fieldlink.site.opcua import OpcuaSettings
from fieldlink.site.opcua_server import OpcuaServerSettings
from fieldlink.site.register_map import COLUMNS

PAGE = (Path(__file__).parents[2] / "docs" / "site-file.md").read_text(encoding="utf-8")

MODELS: list[type[BaseModel]] = [
    SiteSettings,
    Device,
    Tls,
    Quirks,
    OpcuaSettings,
    Loop,
    EstimatorSettings,
    WriteBack,
    ExchangeAddresses,
    WriteLimits,
    CompensateSettings,
    PlantSettings,
    PlantVariables,
    PiSettings,
    ExternalSettings,
    HistorianTable,
    EstimationSettings,
    ReportSettings,
    WebSettings,
    MqttSettings,
    MqttTls,
    MqttSpool,
    OpcuaServerSettings,
]


def default_of(model: type[BaseModel], key: str) -> str:
    field = model.model_fields[key]
    value = field.default
    if field.default_factory is not None:
        value = field.get_default(call_default_factory=True, validated_data={})
    if value is PydanticUndefined:
        return "needed"
    if value is None or isinstance(value, BaseModel):
        return ""
    shown = str(value) if isinstance(value, Path) else value
    return f"`{json.dumps(shown)}`"


def expected_tables() -> Iterator[tuple[str, str, list[list[str]]]]:
    """Give the heading, the sentence and the rows of each table of the site file."""
    for model in MODELS:
        assert model.__doc__ is not None
        found = re.fullmatch(r"``(\[.*?\])``: (.*)", model.__doc__.strip(), re.DOTALL)
        assert found is not None
        rows = [
            [f"`{key}`", default_of(model, key), " ".join(str(field.description).split())]
            for key, field in model.model_fields.items()
        ]
        yield f"`{found[1]}`", found[2][0].upper() + found[2][1:], rows


def test_every_table_and_key_is_documented_as_it_is() -> None:
    for heading, sentence, rows in expected_tables():
        head = f"### {heading}\n\n{sentence}\n\n| key | default | meaning |\n| --- | --- | --- |\n"
        assert head + "".join(f"| {' | '.join(row)} |\n" for row in rows) in PAGE


def test_every_column_and_type_of_a_register_map_is_documented() -> None:
    section = PAGE.split("## Register map")[1].split("\n## ")[0]
    assert tuple(re.findall(r"^\| (\w+) \|", section, re.MULTILINE)[1:]) == COLUMNS
    assert ", ".join(DataType) in section
    assert all(table in section for table in Table)


def test_every_column_of_a_node_map_is_documented() -> None:
    section = PAGE.split("## Node map")[1].split("\n## ")[0]
    assert tuple(re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE)) == NODE_COLUMNS
