"""docs/report.md lists every column in its order."""

from __future__ import annotations

import re
from pathlib import Path

from fieldlink.worklist import COLUMNS, Wrong
from fieldlink.worklist.finding import Action

PAGE = (Path(__file__).parents[2] / "docs" / "report.md").read_text(encoding="utf-8")


def test_every_column_is_documented_in_its_order() -> None:
    table = PAGE.split("## Columns of CSV")[1].split("\n## ")[0]
    names = [name for cell in re.findall(r"^\| (`.*?`) \|", table, re.MULTILINE)
             for name in re.findall(r"`(\w+)`", cell)]  # fmt: skip
    assert tuple(names) == COLUMNS


def test_every_cause_and_action_is_documented() -> None:
    for member in (*Wrong, *Action):
        assert f"`{member.code}`" in PAGE
