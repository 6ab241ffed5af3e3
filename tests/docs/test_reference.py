"""The generated pages of docs/reference are what the program gives today."""

from __future__ import annotations

import re

import pytest

from fieldlink.cli.examples import PANELS
from fieldlink.links.base import Quality
from tests.docs.pages import ROOT
from tools.command_page import commands_by_name
from tools.reference_pages import PAGES, main


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_current(name: str) -> None:
    kept = (ROOT / "docs" / "reference" / name).read_text(encoding="utf-8")
    assert kept == PAGES[name](), "run python -m tools.reference_pages"


def test_every_metric_that_can_be_served_is_there() -> None:
    """Those that a site serves only with findings, notices or MQTT too: read from the program."""
    text = (ROOT / "docs" / "reference" / "metrics.md").read_text(encoding="utf-8")
    served = {
        (kind, name)
        for file in (ROOT / "fieldlink").rglob("*.py")
        for kind, name in re.findall(
            r'(Counter|Gauge|Histogram)MetricFamily\(\s*"(\w+)"', file.read_text(encoding="utf-8")
        )
    }
    assert ("Counter", "fieldlink_diagnoses") in served
    for kind, name in served:
        assert f"| `{name}{'_total' if kind == 'Counter' else ''}` |" in text


def test_pages_are_written(tmp_path) -> None:
    assert main(["--out", str(tmp_path / "new")]) == 0
    assert {path.name for path in (tmp_path / "new").iterdir()} == set(PAGES)


def test_every_command_and_known_keys_are_there() -> None:
    text = PAGES["cli.md"]()
    named = {word for words in PANELS.values() for word in words}
    assert all(f"### fieldlink {name}\n" in text for name in commands_by_name())
    assert "One of `zero`, `one`, `modicon`, `hex`." in text
    assert {name.split()[0] for name in commands_by_name()} <= named
    assert "| `min_windows` | `2` |" in PAGES["site-file-keys.md"]()
    assert "One of `stiction`, `no_stiction`, `not_assessable`." in PAGES["scenario-file-keys.md"]()
    assert "| `fieldlink_device_state` | gauge | `device`, `state` |" in PAGES["metrics.md"]()


def test_every_quality_code_has_a_line_in_the_order_of_the_codes() -> None:
    text = PAGES["quality-codes.md"]()
    codes = [int(code) for code in re.findall(r"^\| (\d+) \|", text, re.MULTILINE)]
    assert codes == sorted(one.code for one in Quality) == list(range(14))
    assert "| 10 | `late` | polled or reported so late" in text
