"""FMUs that the tests of this folder share."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmu_models.packing import build_source
from tests.fmu_models import odd_fmus
from tests.fmu_models.mini_fmus import make


@pytest.fixture(scope="session")
def mini_fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """FMUs without our wrapper: ``fmi1-cs``, ``fmi1-me``, ``fmi2``."""
    return make(tmp_path_factory.mktemp("mini"))


@pytest.fixture(scope="session")
def odd(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """FMI 3 with arrays, events and early return: ``plain``, ``events``, ``long``."""
    return odd_fmus.make(tmp_path_factory.mktemp("odd"))


@pytest.fixture(scope="session")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The plant that goes wrong when told to."""
    source = Path(odd_fmus.SOURCES) / "faulty.c"
    return build_source(source, output=tmp_path_factory.mktemp("faulty"))[1]
