"""The papers of the repository: licence, changelog, and links that lead somewhere."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from fieldlink.store.schema import SCHEMA_VERSION

ROOT = Path(__file__).resolve().parents[2]


def test_the_licence_is_the_one_that_the_package_names() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["license"] == "Apache-2.0"
    for name in project["license-files"]:
        text = (ROOT / name).read_text()
        assert "Version 2.0, January 2004" in text
        assert "9. Accepting Warranty or Additional Liability" in text
        assert "END OF TERMS AND CONDITIONS" in text


def test_the_citation_is_of_this_version_and_licence() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    for key in ("version", "license"):
        assert f"\n{key}: {project[key]}\n" in text
    assert "use of a smoothed model" in text


def test_the_changelog_names_the_schema_of_the_store() -> None:
    newest = (ROOT / "CHANGELOG.md").read_text().split("\n## ")[1]
    assert f"schema {SCHEMA_VERSION}" in newest


@pytest.mark.parametrize("name", ["CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md"])
def test_every_file_that_is_named_exists(name: str) -> None:
    text = (ROOT / name).read_text()
    linked = re.findall(r"\]\((?!https?:)([^)#]+)", text)
    quoted = re.findall(r"`([\w/]+/[\w.]+|pyproject\.toml)`", text)
    for path in {*linked, *quoted}:
        assert (ROOT / path).exists(), path
