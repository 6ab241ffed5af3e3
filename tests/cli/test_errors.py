"""What a user can cause is one sentence; what is our defect keeps its traceback."""

from __future__ import annotations

import pytest

from fieldlink.cli.errors import explain
from fieldlink.errors import FieldlinkError


def test_a_library_that_is_not_installed_is_named_with_its_extra(
    capsys: pytest.CaptureFixture[str],
) -> None:
    missing = ModuleNotFoundError("No module named 'matplotlib'", name="matplotlib")
    assert explain(missing)
    assert capsys.readouterr().err.strip() == (
        "fieldlink: this command needs matplotlib, which is not installed; install it with "
        "pip install 'fieldlink[plot]'"
    )


def test_a_defect_of_ours_is_not_explained_away(capsys: pytest.CaptureFixture[str]) -> None:
    assert not explain(ModuleNotFoundError("No module named 'fieldlnk'", name="fieldlnk"))
    assert not explain(KeyError("op"))
    assert explain(FieldlinkError("loop FC1: it has no PV"))
    assert capsys.readouterr().err == "fieldlink: loop FC1: it has no PV\n"
