from __future__ import annotations

from typing import Any

import pytest

from fieldlink.daemon.estimation.pool import PoolReport


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
        patch.setattr("fieldlink.daemon.estimation.judging.EstimatorPool", NoPool)
        yield
