"""Seeds of a test: the first ones in the suite, all of them with ``make thorough``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

__all__ = ["in_suite"]


def in_suite(kept: int, values: Iterable[object]) -> list[Any]:
    """Return the values as parameters, those behind the first ``kept`` marked ``thorough``."""
    return [
        pytest.param(value, marks=() if rank < kept else pytest.mark.thorough)
        for rank, value in enumerate(values)
    ]
