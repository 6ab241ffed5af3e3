"""FMUs that the tests of this folder share."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fmu_models.mini_fmus import make


@pytest.fixture(scope="session")
def mini_fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """FMUs without our wrapper: ``fmi1-cs``, ``fmi1-me``, ``fmi2``."""
    return make(tmp_path_factory.mktemp("mini"))
