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


def test_every_fault_names_its_proof() -> None:
    page = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8").split("## Known limits")[0]
    faults = re.split(r"^- (?=\*\*)", page, flags=re.MULTILINE)[1:]
    assert len(faults) >= 30
    for fault in faults:
        assert NAMED.search(fault), fault
