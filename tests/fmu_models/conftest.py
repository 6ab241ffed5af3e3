"""FMUs that the tests of this folder share."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from fmu_models.packing import build_source
from tests.fmu_models import odd_fmus
from tests.fmu_models.mini_fmus import make

SOURCES = Path(__file__).with_name("sources")


@pytest.fixture(scope="session")
def faulty_fmus(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The plant that goes wrong when told to: FMI 2 and FMI 3."""
    built = build_source(SOURCES / "faulty.c", output=tmp_path_factory.mktemp("faulty"))
    return built[0], built[1]


@pytest.fixture
def faulty(faulty_fmus: tuple[Path, Path]) -> Path:
    return faulty_fmus[1]


@pytest.fixture
def altered(tmp_path: Path) -> Callable[[Path, Callable[[str, bytes], bytes | None]], Path]:
    """Copy an FMU, each entry changed (or left out) by a function of its name and content."""

    def alter(fmu: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
        target = tmp_path / f"altered-{fmu.name}"
        with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(target, "w") as copy:
            for name in source.namelist():
                content = change(name, source.read(name))
                if content is not None:
                    copy.writestr(name, content)
        return target

    return alter


@pytest.fixture
def program_environment(tmp_path: Path) -> dict[str, str]:
    """The environment of a Python program of a test, with a temporary folder of its own."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    return {**os.environ, "TMPDIR": str(folder)}


@pytest.fixture(scope="session")
def mini_fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """FMUs without our wrapper: ``fmi1-cs``, ``fmi1-me``, ``fmi2`` (co-simulation and exchange)."""
    return make(tmp_path_factory.mktemp("mini"))


@pytest.fixture(scope="session")
def odd(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """FMI 3 with arrays, events and early return: ``plain``, ``events``, ``long``."""
    return odd_fmus.make(tmp_path_factory.mktemp("odd"))
