from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from typing import Any

import pytest

import tests.daemon.live
from tests.links.fake_device import FakeDevice


@pytest.fixture(scope="session")
def live() -> Any:
    """What the tests of the live daemon share: sites, plants, running daemons."""
    return tests.daemon.live


@pytest.fixture(autouse=True, scope="module")
def _unrehearsed() -> Iterator[None]:
    with tests.daemon.live.unrehearsed_pools():
        yield


@pytest.fixture
async def device() -> AsyncIterator[Any]:
    running = FakeDevice()
    await running.start()
    yield running
    await running.stop()
