"""Every block of TOML in a page is one that the program reads: no key is stale or misplaced."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from fieldlink.assess.readers.sql_description import SqlTable
from fieldlink.lab.fmu import FmuMap
from fieldlink.lab.rehearse.models import Scenario
from fieldlink.site.models import SiteFile
from tests.docs.pages import PAGES, Block, blocks_of

TABLES = [block for page in PAGES for block in blocks_of(page) if block.language == "toml"]
LEFT_OUT = {"missing", "default_factory_not_called"}
"""What a page may leave out: a block shows a part of a file."""


def wrong_in(model: type[BaseModel], keys: dict[str, Any]) -> list[str]:
    try:
        model.model_validate(keys)
    except ValidationError as error:
        found = [one for one in error.errors() if one["type"] not in LEFT_OUT]
        return [f"{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in found]
    return []


def model_of(keys: dict[str, Any]) -> tuple[type[BaseModel], dict[str, Any]]:
    """Return the model of a file by a key that only such files have, and what to check."""
    if "sql" in keys:
        return SqlTable, keys["sql"]
    if "outputs" in keys:
        return FmuMap, keys
    if {"scenario", "maintenance"} & keys.keys():
        return Scenario, keys
    return SiteFile, keys


@pytest.mark.parametrize("block", TABLES, ids=lambda block: block.place)
def test_every_key_is_read(block: Block) -> None:
    assert not wrong_in(*model_of(tomllib.loads(block.text)))


def test_a_key_in_another_table_is_found() -> None:
    keys = tomllib.loads('[mqtt]\nhost = "a"\n[mqtt.tls]\nca = "ca.pem"\ncommands = []\n')
    assert wrong_in(*model_of(keys)) == ["mqtt.tls.commands: Extra inputs are not permitted"]
