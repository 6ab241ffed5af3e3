"""Every test that the documents name as a proof exists."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NAMED = re.compile(r"`(tests/[\w/]+\.py)(?:::(\w+))?`")


@pytest.mark.parametrize("page", ["faults.md", "security.md"])
def test_what_is_named_as_proof_exists(page: str) -> None:
    named = NAMED.findall((ROOT / "docs" / page).read_text(encoding="utf-8"))
    assert len(named) >= 10
    for file, test in named:
        assert (ROOT / file).is_file(), file
        if test:
            tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
            functions = (ast.FunctionDef, ast.AsyncFunctionDef)
            names = {node.name for node in ast.walk(tree) if isinstance(node, functions)}
            assert test in names, f"{file} has no {test}"


def test_every_row_of_the_fault_table_names_one() -> None:
    lines = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8").splitlines()
    rows = [line for line in lines if line.startswith("| ") and "| --- |" not in line]
    rows = [row for row in rows if not row.startswith("| fault |")]
    assert len(rows) >= 30
    for row in rows:
        assert NAMED.search(row), row
