from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.made_fleet import Fleet, make_fleet


@pytest.fixture(scope="session")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Fleet:
    """Ten loops, one of each kind and four healthy ones, with sixty daily estimates."""
    made = Fleet(tmp_path_factory.mktemp("fleet") / "history.sqlite", loops=10, days=60)
    make_fleet(made)
    return made


@pytest.fixture
def own_fleet(fleet: Fleet, tmp_path: Path) -> Fleet:
    """A copy that a test may change."""
    file = tmp_path / "history.sqlite"
    file.write_bytes(fleet.file.read_bytes())
    return Fleet(file, fleet.loops, fleet.days)
