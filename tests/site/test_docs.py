"""docs/site-file.md lists the columns of register maps and node maps."""

from __future__ import annotations

import re
from pathlib import Path

from fieldlink.registers import DataType, Table
from fieldlink.site.node_map import NODE_COLUMNS
from fieldlink.site.register_map import COLUMNS

PAGE = (Path(__file__).parents[2] / "docs" / "site-file.md").read_text(encoding="utf-8")


def test_every_column_and_type_of_a_register_map_is_documented() -> None:
    section = PAGE.split("## Register map")[1].split("\n## ")[0]
    assert tuple(re.findall(r"^\| (\w+) \|", section, re.MULTILINE)[1:]) == COLUMNS
    assert ", ".join(DataType) in section
    assert all(table in section for table in Table)


def test_every_column_of_a_node_map_is_documented() -> None:
    columns = PAGE.split("## Node map")[1].split("Columns: ")[1].split(";")[0]
    assert tuple(re.findall(r"`(\w+)`", columns)) == NODE_COLUMNS
