"""Links in README, docs and the files beside them lead to files and headings that are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT

LINKED = sorted(
    [
        *PAGES,
        *(ROOT / "docs" / "benchmarks").glob("*.md"),
        *(ROOT / name for name in ("CHANGELOG.md", "SECURITY.md", "examples/README.md")),
    ]
)
_LINK = re.compile(r"\]\((?!https?:|mailto:)([^)\s]*)\)")


def anchors_of(page: Path) -> set[str]:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", LINKED, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in _LINK.findall(page.read_text(encoding="utf-8")):
        name, _, anchor = target.partition("#")
        found = (page.parent / name).resolve() if name else page
        assert found.exists(), f"{target}: no such file"
        if anchor:
            assert anchor in anchors_of(found), f"{target}: no such heading"
