"""The estimator's rooms: which of them know of which; in no core a module that needs itself."""

from __future__ import annotations

import graphlib
from functools import cache
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[2]

ROOMS = {"prepare", "hypotheses", "search", "criteria", "evidence", "intervals", "valves",
         "processes", "published", "monitoring", "diagnosis", "controller"}  # fmt: skip
"""Rooms that the design names; ``prepare`` and ``report`` are modules beside `identify`."""


@cache
def _arrows(package: str = "estimator") -> dict[str, set[str]]:
    """Modules of a package that each of its modules imports, by name below the package."""
    graph = grimp.build_graph(package, cache_dir=None)
    return {
        module.removeprefix(f"{package}."): {
            name.removeprefix(f"{package}.")
            for name in graph.find_modules_directly_imported_by(module)
        }
        for module in graph.modules
        if module != package
    }


def _imports_of(room: str) -> set[str]:
    """Rooms (or modules beside them) that the modules of a room import."""
    found = {
        name.split(".")[0]
        for module, names in _arrows().items()
        if module.split(".")[0] == room
        for name in names
    }
    return found - {room}


def test_the_rooms_of_the_design_are_there() -> None:
    folders = {path.parent.name for path in (ROOT / "estimator").glob("*/__init__.py")}
    assert folders == ROOMS - {"prepare"}
    modules = {path.stem for path in (ROOT / "estimator").glob("*.py")}
    assert {"window", "rows", "identify", "report", "settings"} <= modules


@pytest.mark.parametrize(
    ("room", "may_know"),
    [
        # laws and processes are added without knowing of evidence or search
        ("valves", {"arrays", "outcomes"}),
        ("arrays", set()),
        ("algebra", {"arrays"}),
        ("lanes", {"arrays"}),
        ("settings", set()),
        ("outcomes", set()),
        # windows are made before anything is known of models
        ("window", {"algebra", "arrays", "outcomes", "settings"}),
        ("rows", {"arrays", "settings", "window"}),
        # a course over many windows is made of results
        ("monitoring", {"arrays", "outcomes", "result"}),
    ],
)
def test_a_lower_room_knows_no_higher_one(room: str, may_know: set[str]) -> None:
    assert _imports_of(room) <= may_know


@pytest.mark.parametrize("apart", ["published", "monitoring", "report", "identify", "diagnosis"])
@pytest.mark.parametrize("room", ["search", "criteria", "evidence", "intervals", "processes"])
def test_the_search_knows_nothing_of_what_stands_beside_or_above_it(room: str, apart: str) -> None:
    assert apart not in _imports_of(room)


@pytest.mark.parametrize(
    ("package", "one_of_it"), [("estimator", "identify"), ("fmu_models", "stepping")]
)
def test_no_module_needs_itself(package: str, one_of_it: str) -> None:
    order = graphlib.TopologicalSorter(_arrows(package)).static_order()
    assert one_of_it in list(order)
