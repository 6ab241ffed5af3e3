from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest

from fieldlink.daemon.pool import PoolReport


def load_helper(name: str) -> Any:
    """Import a helper that lies beside the tests; they are no package."""
    known = f"fieldlink_faults_{name}"
    if known not in sys.modules:
        spec = importlib.util.spec_from_file_location(known, Path(__file__).with_name(f"{name}.py"))
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[known] = module
        spec.loader.exec_module(module)
    return sys.modules[known]


@pytest.fixture(scope="session")
def plant() -> Any:
    return load_helper("plant")


@pytest.fixture(scope="session")
def proxy() -> Any:
    return load_helper("proxy")


class NoPool:
    """Stands for the estimator's processes where no window is ever judged."""

    def __init__(self, *_: object) -> None:
        pass

    async def warm_up(self) -> None:
        pass

    async def close(self) -> None:
        pass

    def report(self) -> PoolReport:
        return PoolReport()


@pytest.fixture(autouse=True, scope="module")
def _no_pool() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fieldlink.daemon.service.EstimatorPool", NoPool)
        yield
