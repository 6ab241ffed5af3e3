from __future__ import annotations

import importlib.util
import sys
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from tests.links.fake_device import FakeDevice

HELPER = Path(__file__).resolve().parent / "fake_device.py"


def load_helper(path: Path) -> Any:
    """Import a helper that lies beside the tests; they are no package."""
    name = f"fieldlink_tests_{path.stem}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


@pytest.fixture
async def new_device() -> AsyncIterator[Callable[..., FakeDevice]]:
    made = []

    def make(**settings: Any) -> FakeDevice:
        device: FakeDevice = load_helper(HELPER).FakeDevice(**settings)
        made.append(device)
        return device

    yield make
    for device in made:
        await device.stop()


@pytest.fixture
async def device(new_device: Callable[..., FakeDevice]) -> FakeDevice:
    running = new_device()
    await running.start()
    return running
