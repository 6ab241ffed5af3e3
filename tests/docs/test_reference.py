"""The generated pages of docs/reference are what the program gives today."""

from __future__ import annotations

import pytest

from fieldlink.cli.examples import PANELS
from tests.docs.pages import ROOT
from tools.command_page import commands_by_name
from tools.reference_pages import PAGES, main


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_current(name: str) -> None:
    kept = (ROOT / "docs" / "reference" / name).read_text(encoding="utf-8")
    assert kept == PAGES[name](), "run python -m tools.reference_pages"


def test_pages_are_written(tmp_path) -> None:
    assert main(["--out", str(tmp_path / "new")]) == 0
    assert {path.name for path in (tmp_path / "new").iterdir()} == set(PAGES)


def test_every_command_and_known_keys_are_there() -> None:
    text = PAGES["cli.md"]()
    named = {word for words in PANELS.values() for word in words}
    assert all(f"### fieldlink {name}\n" in text for name in commands_by_name())
    assert {name.split()[0] for name in commands_by_name()} <= named
    assert "| `min_windows` | `2` |" in PAGES["site-file-keys.md"]()
    assert "One of `stiction`, `no_stiction`, `not_assessable`." in PAGES["scenario-file-keys.md"]()
    assert "| `fieldlink_device_state` | gauge | `device`, `state` |" in PAGES["metrics.md"]()
