"""The picture of the architecture, and the page that explains it, name what the code has."""

from __future__ import annotations

from pathlib import Path

from benchmarks.house_picture import (
    CORES,
    WALKS,
    imports_between,
    layers,
    missing_names,
    without_detours,
)

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "architecture.md").read_text()


def test_every_step_of_a_walk_is_in_the_code_and_on_the_page() -> None:
    assert list(missing_names()) == []
    for title, steps in WALKS.items():
        section = PAGE.split(f"## {title.capitalize()}\n")[1].split("\n## ")[0]
        found = [line.split("`")[1] for line in section.splitlines() if line[:1].isdigit()]
        assert found == [name for _, name in steps]


def test_no_package_imports_upwards() -> None:
    rows = layers()
    height = {name: -i for i, row in enumerate(rows) for name in row}
    counts = imports_between([*height, *CORES])
    assert counts["fieldlink.daemon", "fieldlink.links"] > 0
    assert all(height[a] > height[b] for a, b in counts if a in height and b in height)


def test_a_detour_is_not_drawn() -> None:
    assert set(without_detours({("a", "b"): 1, ("b", "c"): 1, ("a", "c"): 5})) == {
        ("a", "b"),
        ("b", "c"),
    }
