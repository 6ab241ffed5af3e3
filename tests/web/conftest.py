from __future__ import annotations

import importlib.util
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest


def _load(path: Path) -> Any:
    name = f"fieldlink_tests_{path.stem}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


@pytest.fixture(scope="session")
def live() -> Any:
    """What the tests of the live daemon share: sites, plants, running daemons."""
    return _load(Path(__file__).parents[1] / "daemon" / "test_daemon.py")


@pytest.fixture
async def device() -> AsyncIterator[Any]:
    running = _load(Path(__file__).parents[1] / "links" / "fake_device.py").FakeDevice()
    await running.start()
    yield running
    await running.stop()
